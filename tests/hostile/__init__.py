"""Damaged logs: every sample cut and mutated, and what must hold whatever is in a file.

A reader returns a `Log` or raises a `LevelheadError` of one printable sentence; it prints nothing, lets no warning out,
and takes neither long nor much memory. Of a cut file the good beginning is kept and the log marked, or the file is
refused. The quick form is ``tests/logs/readers/test_hostile.py``; ``make fuzz`` runs `hostile.table`, which cuts at
every byte and mutates ten thousand times, and `hostile.guided`, where atheris looks for new paths through the readers.
"""
