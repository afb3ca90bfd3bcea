"""The fault campaign: runs of the program on a simulated axis that is hurt, judged by what was true on it.

`cases` draws what happens from a seed, `here` and `wire` let it happen, `judge` reads the plant's log and
compares it with limits, settings and every claim in words. `python -m bench.faults --help` says how.
"""
