"""Settings for programs on a CPU; memory in separate processes, because it is permanent."""

import sys

import pytest
from helpers.commands import python

_PAGE_FAULTS_OF_SECOND = """
import resource, threading
import numpy as np
from psgn_jax.system.cpu import keep_freed_memory

assert keep_freed_memory()

def page_faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

def run():
    np.ones(2**27, np.uint8)
    before = page_faults()
    np.ones(2**27, np.uint8)
    print(page_faults() - before)

run()
thread = threading.Thread(target=run)
thread.start()
thread.join()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="a setting of glibc")
def test_memory_is_used_again_without_page_faults():
    done = python(_PAGE_FAULTS_OF_SECOND)
    # 128 MiB are 32,768 pages of 4 KiB, or 64 huge pages.
    assert max(map(int, done.stdout.split())) < 50
