"""Threads of linear algebra; apart from all that imports numpy, before which it is to be set."""

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables of the environment that keep BLAS to one thread where they are 1 before numpy is imported."""
