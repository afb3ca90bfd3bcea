"""Arguments in, text and exit codes out; puts the parts together."""

import os

# one command is one thread: sums over several cores gain nothing at these sizes and take them from the loop
os.environ.setdefault("OMP_NUM_THREADS", "1")
