# SPDX-License-Identifier: Apache-2.0
"""A virtual X display for programs that open windows."""
import os
import subprocess
import tempfile

CPU_DRIVER = "/usr/share/vulkan/icd.d/lvp_icd.x86_64.json"


class Display:
    """Runs Xvfb on a free display number; programs on it need `environment`."""

    def __enter__(self):
        self.folder = tempfile.TemporaryDirectory(prefix="stgs-display-")
        read, write = os.pipe()
        # -noreset: a reset after the last program ends could disconnect the next one.
        self.server = subprocess.Popen(
            ["Xvfb", "-displayfd", str(write), "-screen", "0", "1600x1000x24", "-nolisten", "tcp",
             "-noreset"],
            pass_fds=[write], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(write)
        with os.fdopen(read) as number:
            display = number.readline().strip()
        if not display:
            raise RuntimeError("Xvfb does not start")
        self.environment = dict(os.environ, DISPLAY=":" + display, XDG_RUNTIME_DIR=self.folder.name)
        self.environment.pop("WAYLAND_DISPLAY", None)
        # A GPU cannot present to windows of Xvfb.
        if os.path.exists(CPU_DRIVER):
            self.environment["VK_ICD_FILENAMES"] = CPU_DRIVER
        return self

    def __exit__(self, *_):
        self.server.terminate()
        self.server.wait()
        self.folder.cleanup()
