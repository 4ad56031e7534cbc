"""A node that has done its work ends, even if a library does not return while it is closed."""

import subprocess
import sys

HANGING = """
import threading
from subsoil_ros.ros.process.node_process import leave_in_time
leave_in_time("mechanism", {status}, 0.1)
threading.Event().wait()
"""


def test_a_node_that_does_not_close_ends_with_its_status() -> None:
    """With the status of the run, and one line that says so."""
    for status in (0, 3):
        program = [sys.executable, "-c", HANGING.format(status=status)]
        done = subprocess.run(program, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == status
        assert done.stderr.startswith("mechanism: DDS did not close within 0.1 s; ")
