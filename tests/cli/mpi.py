# SPDX-License-Identifier: Apache-2.0
"""Tests with several processes that mpirun starts."""
import os
import re
import shlex
import shutil
import subprocess

import harness
from harness import CliTest

MPIRUN = ["mpirun", "--allow-run-as-root", "--oversubscribe", "--bind-to", "none"]
# Seconds for a run: sanitizers are 10 times slower.
TIMEOUT = 600 if os.environ.get("STGS_SANITIZE") else 120


def mpirun_version():
    text = subprocess.run(["mpirun", "--version"], capture_output=True, text=True, check=True).stdout
    return int(re.search(r"(\d+)\.\d+", text).group(1))


class MpiTest(CliTest):
    def setUp(self):
        super().setUp()
        if not harness.built_in("mpi"):
            self.skipTest("MPI is not built in: install libopenmpi-dev and configure again")
        if shutil.which("mpirun") is None:
            self.skipTest("mpirun not found: install openmpi-bin")
        # Open MPI leaks memory.
        self.environment = dict(os.environ, ASAN_OPTIONS="detect_leaks=0")

    def mpirun(self, *commands, processes=2):
        """Runs one process per command, or `processes` of a single command."""
        lines = [shlex.join([harness.STGS, *map(str, command)]) for command in commands]
        # Not with "COMMAND : COMMAND": mpirun 5.0.7 crashes if one of two commands fails.
        script = f'if [ "$OMPI_COMM_WORLD_RANK" = 0 ]; then exec {lines[0]}; fi; exec {lines[-1]}'
        args = [*MPIRUN, "-np", str(processes), "sh", "-c", script]
        return subprocess.run(args, cwd=self.work, env=self.environment, capture_output=True,
                              text=True, timeout=TIMEOUT, check=False)

    def both_succeed(self, *commands, processes=2):
        result = self.mpirun(*commands, processes=processes)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assert_no_leftovers()
        return result

    def both_fail(self, code, message, *commands):
        """Checks that one process prints the error and that mpirun has its exit code."""
        result = self.mpirun(*commands)
        self.assertEqual(result.returncode, code, result.stderr)
        errors = re.findall(r"(?m)^stgs: error: .*$", result.stderr)
        self.assertEqual(len(errors), 1, result.stderr)
        self.assertRegex(errors[0], message)
        self.assertFalse(os.path.exists(self.path("out.stgs")))
        self.assert_no_leftovers()

    def ranks_of(self, process):
        """Returns the process ids of the ranks of an mpirun."""
        return [pid for pid in map(int, filter(str.isdigit, os.listdir("/proc")))
                if self.stat(pid)[1:2] == [str(process.pid)]]

    def stat(self, pid):
        """Returns the state, parent and further fields of a process (proc(5)), or []."""
        try:
            with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as file:
                return file.read().rsplit(")", 1)[1].split()
        except (FileNotFoundError, ProcessLookupError):
            return []
