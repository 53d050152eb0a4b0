#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The Debian packages have the expected contents and dependencies, and applications build with them.

Creates the packages with cpack, inspects them with dpkg-deb, unpacks them into an empty folder, and
builds and runs the example against that folder alone. Exit code 77: dpkg-deb or dpkg-shlibdeps is
missing.
"""
import argparse
import glob
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

from outside import read_png, run

ARGUMENTS = None
SKIPPED = 77
LIBRARIES = "usr/lib/**/"
OPENCV_MODULE = LIBRARIES + "stgs/stgs_opencv.so"
# Patterns of the paths that must be in each package and in no other.
CONTENTS = {
    "libstgs0": [LIBRARIES + "libstgs.so.0", LIBRARIES + "libstgs.so.0.*"],
    "libstgs-dev": ["usr/include/stgs/stgs.h", LIBRARIES + "libstgs.so", LIBRARIES + "libstgs.a",
                    LIBRARIES + "cmake/stgs/stgsConfig.cmake",
                    LIBRARIES + "cmake/stgs/stgs-shared.cmake",
                    LIBRARIES + "cmake/stgs/stgs-static.cmake", LIBRARIES + "pkgconfig/stgs.pc",
                    "usr/share/doc/libstgs-dev/examples/CMakeLists.txt",
                    "usr/share/doc/libstgs-dev/examples/minimal.c"],
    "libstgs-doc": ["usr/share/doc/libstgs-doc/html/index.html",
                    "usr/share/doc/libstgs-doc/html/guide_captures.html",
                    "usr/share/doc/libstgs-doc/html/group__api__scenes.html",
                    "usr/share/doc/libstgs-doc/html/format_stgs_format.html",
                    "usr/share/doc/libstgs-doc/html/site.css"],
    "libstgs-encoder0": [LIBRARIES + "libstgs_encoder.so.0", LIBRARIES + "libstgs_encoder.so.0.*"],
    "libstgs-encoder-dev": ["usr/include/stgs/stgs_encoder.h", LIBRARIES + "libstgs_encoder.so",
                            LIBRARIES + "libstgs_encoder.a",
                            LIBRARIES + "cmake/stgs/stgs-encoder.cmake",
                            LIBRARIES + "cmake/stgs/stgs-encoder_static.cmake",
                            LIBRARIES + "pkgconfig/stgs_encoder.pc",
                            "usr/share/doc/libstgs-encoder-dev/examples/CMakeLists.txt",
                            "usr/share/doc/libstgs-encoder-dev/examples/encode.c",
                            "usr/share/doc/libstgs-encoder-dev/examples/telepresence_cameras.cpp",
                            "usr/share/doc/libstgs-encoder-dev/examples/telepresence_recorder.cpp"],
    "stgs": ["usr/bin/stgs", "usr/share/bash-completion/completions/stgs",
             "usr/share/fish/vendor_completions.d/stgs.fish",
             "usr/share/zsh/vendor-completions/_stgs",
             "usr/share/man/man1/stgs.1.gz", "usr/share/man/man1/stgs-render.1.gz",
             LIBRARIES + "cmake/stgs/stgs-tools.cmake", OPENCV_MODULE],
    "stgs-mpi": [LIBRARIES + "stgs/stgs_mpi.so"],
    "python3-stgs": ["usr/lib/python3/dist-packages/stgs.*.so",
                     "usr/lib/python3/dist-packages/stgs-stubs/__init__.pyi"],
}


def has_opencv():
    return os.path.exists(os.path.join(ARGUMENTS.build, "bin/stgs_opencv.so"))


def expected_contents(name):
    return [pattern for pattern in CONTENTS[name] if pattern != OPENCV_MODULE or has_opencv()]


def field(package, name):
    return run("dpkg-deb", "-f", package, name).strip()


def depends(package):
    """Returns the names of the packages that a package depends on."""
    return {word.split()[0] for word in field(package, "Depends").split(", ") if word}


class Packages(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp()
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        run(ARGUMENTS.cpack, "-G", "DEB", "-B", cls.at("debs"), cwd=ARGUMENTS.build)
        cls.packages = {field(path, "Package"): path for path in glob.glob(cls.at("debs/*.deb"))}
        for path in cls.packages.values():
            run("dpkg", "-x", path, cls.at("root"))
        run(ARGUMENTS.fixture, cls.folder)

    @classmethod
    def at(cls, name):
        return os.path.join(cls.folder, name)

    def find(self, pattern, root="root"):
        return glob.glob(os.path.join(self.at(root), pattern), recursive=True)

    def test_the_expected_packages_are_created(self):
        needs = {"stgs-mpi": "bin/stgs_mpi.so", "python3-stgs": "python/stgs.*.so",
                 "libstgs-doc": "sdk/docs/Doxyfile"}
        not_built = {name for name, file in needs.items()
                     if not glob.glob(os.path.join(ARGUMENTS.build, file))}
        self.assertEqual(set(self.packages), set(CONTENTS) - not_built)
        for name, path in self.packages.items():
            version, architecture = field(path, "Version"), field(path, "Architecture")
            self.assertEqual(version, ARGUMENTS.version + "-1")
            self.assertEqual(os.path.basename(path), f"{name}_{version}_{architecture}.deb")
            self.assertRegex(field(path, "Maintainer"), r"^[^<]+ <\S+@\S+>$")
            synopsis = field(path, "Description").splitlines()[0]
            self.assertTrue(10 < len(synopsis) < 80, synopsis)

    def test_packages_have_the_expected_contents(self):
        contents = {}
        for name, path in self.packages.items():
            run("dpkg", "-x", path, self.at(name))
            contents[name] = {os.path.relpath(file, self.at(name))
                              for file in self.find("**", name)
                              if not os.path.isdir(file) or os.path.islink(file)}
            for pattern in expected_contents(name):
                self.assertTrue(self.find(pattern, name), f"{name} lacks {pattern}")
            document = os.path.join("usr/share/doc", name)
            for file in "copyright", "changelog.gz", "changelog.Debian.gz":
                self.assertIn(os.path.join(document, file), contents[name])
            with open(os.path.join(self.at(name), document, "copyright"), encoding="utf-8") as text:
                self.assertIn("License: Apache-2.0", text.read())
            # Everything else must be a document, a manual page, a header or a CMake script.
            known = {file for pattern in expected_contents(name) for file in self.find(pattern, name)}
            for file in contents[name]:
                if not re.match(r"usr/(share/(doc|man)|include/stgs|lib/.*cmake/stgs)/", file):
                    self.assertIn(os.path.join(self.at(name), file), known)
            for file in contents[name]:  # headers that an example includes are packaged
                if "/examples/" in file and file.endswith((".c", ".cpp", ".h")):
                    with open(os.path.join(self.at(name), file), encoding="utf-8") as text:
                        included = re.findall(r'#include ["<](stgs/[^">]+)', text.read())
                    for header in included:
                        self.assertTrue(self.find(f"usr/include/{header}"), f"{file}: {header}")
        all_files = [file for files in contents.values() for file in files]
        self.assertEqual(len(all_files), len(set(all_files)), "a file is in two packages")

    def test_packages_have_the_expected_dependencies(self):
        needs = {name: depends(path) for name, path in self.packages.items()}
        self.assertIn("libc6", needs["libstgs0"])
        self.assertIn("libdeflate0", needs["libstgs0"])
        encoder_only = {word for word in needs["libstgs0"]
                        if re.match(r"libopencv|libglfw|libopenexr|libopenmpi|libpython", word)}
        self.assertEqual(encoder_only, set(), "libstgs0 depends on libraries of the encoder")
        version = f"(= {field(self.packages['libstgs0'], 'Version')})"
        exactly = f"libstgs0 {version}"
        self.assertEqual(field(self.packages["libstgs-dev"], "Depends"), exactly)
        self.assertEqual(field(self.packages["libstgs-encoder-dev"], "Depends"),
                         f"libstgs-encoder0 {version}, libstgs-dev {version}")
        self.assertFalse({word for word in needs["libstgs-encoder0"]
                          if re.match(r"libstgs|libglfw|libopenexr|libopenmpi|libcurl", word)})
        self.assertNotIn("libstgs0", needs["stgs"])
        self.assertEqual(any("libopencv-videoio" in word for word in needs["stgs"]), has_opencv())
        self.assertFalse({word for word in needs["stgs"] if "mpi" in word}, "stgs depends on MPI")
        if "stgs-mpi" in needs:
            self.assertTrue({word for word in needs["stgs-mpi"] if "libopenmpi" in word
                             or "libmpich" in word}, needs["stgs-mpi"])
        if "python3-stgs" in needs:
            self.assertIn(exactly, field(self.packages["python3-stgs"], "Depends"))
            self.assertLessEqual({"python3", "python3-numpy"}, needs["python3-stgs"])
        for package, library in ("libstgs0", "libstgs"), ("libstgs-encoder0", "libstgs_encoder"):
            run("dpkg-deb", "-e", self.packages[package], self.at(f"control_{package}"))
            with open(self.at(f"control_{package}/shlibs"), encoding="utf-8") as file:
                self.assertEqual(file.read(), f"{library} 0 {package} {version}\n")

    @unittest.skipUnless(shutil.which("apt-get"), "needs apt-get")
    def test_apt_can_install_the_packages(self):
        output = run("apt-get", "--simulate", "--no-install-recommends", "install",
                     *self.packages.values())
        self.assertEqual(set(re.findall(r"^Inst (\S+)", output, re.MULTILINE)), set(self.packages))

    def test_binaries_are_stripped_and_have_no_rpath(self):
        binaries = [path for path in self.find("usr/bin/*") + self.find("usr/lib/**/*.so*")
                    if not os.path.islink(path)]
        packages = [name for name in self.packages if not name.endswith(("-dev", "-doc"))]
        self.assertEqual(len(binaries), len(packages) + has_opencv())
        for path in binaries:
            self.assertNotIn("debug_info", run("readelf", "-S", path))
            self.assertNotRegex(run("readelf", "-d", path), "RPATH|RUNPATH")

    def build_consumer(self, prefix, components, library="stgs::stgs"):
        build = tempfile.mkdtemp(dir=self.folder)
        configured = subprocess.run(
            [ARGUMENTS.cmake, "-S", os.path.join(ARGUMENTS.source, "tests/install/consumer"), "-B",
             build, f"-DCMAKE_PREFIX_PATH={prefix}", f"-DCMAKE_C_COMPILER={ARGUMENTS.cc}",
             f"-DLIBRARY={library}", f"-DCOMPONENTS={components}",
             f"-DEXAMPLE={self.find('usr/share/doc/libstgs-dev/examples/minimal.c')[0]}"],
            capture_output=True, text=True, check=False)
        if configured.returncode != 0:
            return None, configured.stderr
        built = run(ARGUMENTS.cmake, "--build", build)
        return os.path.join(build, "consumer"), built

    def test_the_example_builds_against_the_packages_and_renders(self):
        program, built = self.build_consumer(self.at("root/usr"), "shared;tools")
        self.assertIsNotNone(program, built)
        self.assertIn(f"stgs {ARGUMENTS.version}\n", built)  # printed by the packaged program
        run(program, self.at("tiny.stgs"), "0.1", self.at("packaged.png"))
        run(ARGUMENTS.minimal, self.at("tiny.stgs"), "0.1", self.at("example.png"))
        self.assertEqual(read_png(self.at("packaged.png")), read_png(self.at("example.png")))

    def test_a_missing_component_is_reported(self):
        for name in "libstgs0", "libstgs-dev":
            run("dpkg", "-x", self.packages[name], self.at("library"))
        prefix = self.at("library/usr")
        program, output = self.build_consumer(prefix, "shared")
        self.assertIsNotNone(program, output)
        for component in "tools", "encoder":
            program, output = self.build_consumer(prefix, component)
            self.assertIsNone(program)
            self.assertIn(f"'{component}'", output)

    def test_the_program_loads_its_mpi_module(self):
        if "stgs-mpi" not in self.packages or shutil.which("mpirun") is None:
            self.skipTest("needs MPI and mpirun")
        error = subprocess.run(
            ["mpirun", "--allow-run-as-root", "--oversubscribe", "-np", "2",
             self.at("root/usr/bin/stgs"), "train", self.at("none"), "-o", self.at("t.stgs")],
            capture_output=True, text=True, check=False).stderr
        self.assertIn("none", error)
        self.assertNotIn("could not be loaded", error)
        self.assertNotIn("is missing (expected in", error)

    def test_the_quick_start_produces_an_image(self):
        """Runs the commands in sdk/docs/README.md; unpacking the packages replaces the first one."""
        with open(os.path.join(ARGUMENTS.source, "sdk/docs/README.md"), encoding="utf-8") as file:
            text = file.read()
        commands = re.search(r"```sh\n(.*?)```", text, re.DOTALL).group(1).splitlines()
        self.assertEqual(len(commands), 4)
        self.assertIn("in four commands", text)
        installs = commands[0].split()
        self.assertEqual(installs[:3], ["sudo", "apt", "install"])
        root = self.at("quick_start")
        for pattern in installs[3:]:
            if not pattern.startswith("./"):  # a package of the distribution
                run("dpkg", "-s", pattern)
                continue
            found = glob.glob(os.path.join(self.at("debs"), pattern))
            self.assertEqual(len(found), 1, pattern)
            run("dpkg", "-x", found[0], root)
        work = self.at("work")
        os.mkdir(work)
        os.symlink(os.path.join(ARGUMENTS.source, "tests/data/workshop"), f"{work}/capture")
        library = os.path.dirname(self.find(LIBRARIES + "libstgs.so.0", root)[0])
        environment = dict(os.environ, LD_LIBRARY_PATH=library,
                           PATH=f"{root}/usr/bin:{os.environ['PATH']}",
                           PKG_CONFIG_PATH=f"{library}/pkgconfig")
        if " prepare" not in run(f"{root}/usr/bin/stgs", "--version"):
            self.skipTest("needs a build with OpenCV")
        for command in commands[1:]:
            if command.startswith("stgs encode"):  # shortened: only checks that it works
                command += (" --scale 0.25 --frames 0:4 --iterations 5 --num-evals 0"
                            " --max-static-points 1000 --max-dynamic-points 100")
            run("sh", "-c", command.replace("/usr/share", f"{root}/usr/share"), cwd=work,
                env=environment)
        width, height, pixels = read_png(f"{work}/image.png")
        self.assertGreater(min(width, height), 50)
        self.assertGreater(len(set(pixels)), 20)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for argument in ("build", "source", "fixture", "minimal", "cmake", "cpack", "cc", "version"):
        parser.add_argument(f"--{argument}", required=True)
    ARGUMENTS, rest = parser.parse_known_args()
    missing = [name for name in ("dpkg-deb", "dpkg-shlibdeps") if shutil.which(name) is None]
    if missing:
        print(f"skipped: needs {', '.join(missing)}")
        sys.exit(SKIPPED)
    unittest.main(argv=["test_packages.py", *rest])
