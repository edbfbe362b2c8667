"""Small files of every format, made from one simulated drive: `write(folder)` of each module returns the log's path."""
