"""The report: one self-contained HTML page per result, readable offline and on paper."""
