# SPDX-License-Identifier: Apache-2.0
"""The wheel of the Python module, installed into an empty folder.

usage: test_wheel.py WHEEL_SCRIPT MODULE BUILD VERSION MAKE_FIXTURE
"""
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
import zipfile

WHEEL_SCRIPT, MODULE, BUILD, VERSION, MAKE_FIXTURE = sys.argv[1:6]

# Renders a frame and prints the loaded libraries.
PROGRAM = """
import stgs
scene = stgs.Scene("fixture/tiny.stgs")
image = stgs.Renderer("cpu").render(scene, 0.1, scene.first_view().resized(32, 24), ["rgba8"])
assert image.rgba8.shape == (24, 32, 4) and image.rgba8.any()
print(stgs.__file__)
print("".join(line for line in open("/proc/self/maps") if ".so" in line))
"""


def run(*command, **options):
    return subprocess.run(list(map(str, command)), check=True, capture_output=True, text=True,
                          timeout=300, **options).stdout


class Wheel(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.wheel = cls.make("wheel")

    @classmethod
    def make(cls, name):
        """Returns the path of a wheel made in an empty folder."""
        folder = cls.folder / name
        folder.mkdir()
        return pathlib.Path(run(sys.executable, WHEEL_SCRIPT, MODULE, BUILD, VERSION, folder).strip())

    def install(self):
        """Installs the wheel as pip does, without pip if that is missing. Returns the folder."""
        target = self.folder / "installed"
        if subprocess.run([sys.executable, "-m", "pip", "--version"], capture_output=True,
                          check=False).returncode == 0:
            run(sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "--target", target,
                self.wheel)
        else:
            with zipfile.ZipFile(self.wheel) as archive:
                archive.extractall(target)
        return target

    def test_an_installed_wheel_uses_its_own_libraries(self):
        self.assertRegex(self.wheel.name, rf"^stgs-{VERSION}-cp3\d+-cp3\d+-linux_\w+\.whl$")
        target = self.install()
        self.assertTrue((target / "stgs-stubs" / "__init__.pyi").exists())
        (self.folder / "fixture").mkdir()
        run(MAKE_FIXTURE, self.folder / "fixture")
        out = run(sys.executable, "-c", PROGRAM, cwd=self.folder,
                  env={**os.environ, "PYTHONPATH": str(target)})
        self.assertTrue(out.startswith(str(target)), out)
        self.assertIn(f"{target}/stgs.libs/libfmt.so", out)
        self.assertNotIn(BUILD + "/", out)

    def test_the_same_files_give_the_same_bytes(self):
        self.assertEqual(self.make("again").read_bytes(), self.wheel.read_bytes())

    def test_the_record_lists_every_file(self):
        with zipfile.ZipFile(self.wheel) as archive:
            names = set(archive.namelist())
            record = archive.read(f"stgs-{VERSION}.dist-info/RECORD").decode().splitlines()
        self.assertEqual({line.split(",")[0] for line in record}, names)
        self.assertIn(f"stgs-{VERSION}.dist-info/licenses/libzstd1", names)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
