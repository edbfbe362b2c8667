"""Small files of every format, made from one simulated drive, so that what a reader returns can be held against it.

Each module is one format. ``write(folder)`` writes the drive into the folder, the same bytes each time, and returns the
path that `levelhead.read` takes; the drive is what `samples.drive.sample_drive` says at that moment. What else a module
may say, for `hostile`, which damages the files of every sample, and for ``benchmarks/reading.py``:

``GNSS_ONLY = True``
    The file has no IMU data: it is read beside a canonical IMU file of the same drive. ``TIME_SCALE`` ("GPST", the
    default, or "UTC") is the scale of its stamps, seconds since 1970.
``write_gnss(folder)``
    Writes the GNSS file that is passed beside the log, where it is not found by its name.
``MAPPING = "..."``
    The text of the mapping file that it needs.
``OPTIONS = {...}``
    More arguments of `levelhead.read`.
``SHORTEST_S = s``
    The reader finds out what the numbers mean only in a drive as long as this.
``CUT_UNSEEN``
    Where a cut file cannot be told from a whole one: a sentence that says why (of any cut), or a function of the file's
    name, its content and the length that is left. `samples.cuts` has those of texts.
``KEEPS_PREFIX = False``
    Nothing, or not the beginning, can be had from a cut file: its index is at the end, or others have the same epochs.
``LOST_AT_CUT = n``
    Samples before a cut that may be lost with it (blocks that are whole or nothing).
``CHECKED = True``
    Every record has a checksum: a change is seen, or changes nothing.
``CLOCK_TOLERANCE_S = s``
    The stamps depend on the whole file (a clock that is fitted), by this much.
"""
