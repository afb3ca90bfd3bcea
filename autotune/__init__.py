"""autotune: tunes servo axes by experiment, model and proof."""

import os

# Many small matrix products: threads of the linear algebra would only wait for each other. Must be set
# before numpy is imported for the first time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"
