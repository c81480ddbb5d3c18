"""Thread limits of BLAS during a diagnosis."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from irt.diagnosis.run import diagnose


def blas_threads():
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.mark.skipif(not blas_threads(), reason="no BLAS library here reports its threads")
def test_matrices_get_one_thread_and_theirs_back_afterwards(plant):
    seen = set()

    def stop(_done, _total, _text):
        seen.update(blas_threads())
        raise KeyboardInterrupt

    with threadpool_limits(2, user_api="blas"):
        with pytest.raises(KeyboardInterrupt):
            diagnose(plant(runs=2, rows=40).rig, progress=stop)
        assert blas_threads() == {2}
    assert seen == {1}
