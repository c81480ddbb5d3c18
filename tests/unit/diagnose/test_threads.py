"""A diagnosis says the same on any machine."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from irt.diagnose.run import Interrupted, diagnose


def blas_threads():
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_sums_do_not_depend_on_how_many_threads_matrices_get(plant):
    seen = set()

    def stop(_done, _total, _text):
        seen.update(blas_threads())
        raise KeyboardInterrupt

    with threadpool_limits(2, user_api="blas"):
        with pytest.raises(Interrupted):
            diagnose(plant(runs=2, rows=40).rig, progress=stop)
        assert blas_threads() == {2}
    assert seen == {1}
