# SPDX-License-Identifier: Apache-2.0
"""Outputs that cannot be written, that exist already, or that are the input."""
import fcntl
import os
import resource
import shutil
import subprocess
import unittest

import harness
from harness import CliTest

USAGE, IO = 1, 2


class Outputs(CliTest):
    def test_pack_rejects_its_input_as_output(self):
        shutil.copy(self.fixture("tiny.stgs"), self.path("scene.stgs"))
        size = os.path.getsize(self.path("scene.stgs"))
        os.link(self.path("scene.stgs"), self.path("same.stgs"))
        for output in ("scene.stgs", "./scene.stgs", "same.stgs"):
            self.fails(USAGE, "is the input scene itself", "pack", "scene.stgs", "-o", output)
        self.assertEqual(os.path.getsize(self.path("scene.stgs")), size)

    def render(self, output, *more):
        return ["render", self.fixture("tiny.stgs"), "--frames", "0:1", "-o", output, *more]

    def test_unwritable_paths_are_rejected(self):
        self.write("file", b"")
        os.symlink("/dev/full", self.path("full.png"))
        cases = [
            ("folder 'nowhere' does not exist; create it", "nowhere/out.png"),
            ("'file' is not a folder; choose another path", "file/out.png"),
            ("'.*prepared' is not a folder|does not exist", "file/more/out.png"),
            ("cannot create", "/proc/out.png"),
            ("exists and is not a regular file", "full.png"),
            ("File name too long", "x" * 300 + ".png"),
            ("cannot create|does not exist", "/proc/folder/"),
        ]
        for message, output in cases:
            with self.subTest(output=output):
                self.fails(IO, message, *self.render(output))
        for name in ("out.y4m", "out.mp4", "out.exr"):
            with self.subTest(name=name):
                self.fails(IO, "cannot create", *self.render("/proc/" + name))

    def test_a_full_disk_preserves_the_old_output(self):
        """A file size limit has the effect of a full disk, for any user."""
        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        size = ["--size", "640x480", "--log-level", "error"]
        for name in ("out.png", "out.y4m", "out.exr", "out.mp4"):
            feature = {"out.exr": "exr", "out.mp4": "mp4"}.get(name)
            if feature and not harness.built_in(feature):
                continue
            with self.subTest(name=name):
                self.write(name, b"old")
                result = self.stgs(*self.render(name, *size), preexec_fn=limit)
                self.assertEqual(result.returncode, IO, result.stderr)
                self.assertIn(f"{name}: cannot write".encode(), result.stderr)
                self.assertEqual(self.read(name), b"old")
                self.assert_no_leftovers()
        result = self.stgs(*self.render("frames/", *size), preexec_fn=limit)
        self.assertEqual(result.returncode, IO, result.stderr)
        self.assertFalse(os.path.exists(self.path("frames")))
        self.assert_no_leftovers()

    def leftovers_of(self, output):
        """Creates what a killed run with this output leaves: a file and a folder."""
        stem, extension = os.path.splitext(output)
        file = self.write(f".{stem}.abcdefghijkl.tmp{extension}", b"half")
        folder = self.path(f".{output}.abcdefghijkl.tmp.work")
        os.makedirs(folder + "/inner")
        self.write(folder + "/lock", b"")
        return [file, folder]

    def test_leftovers_of_killed_runs_are_removed_by_the_next(self):
        shutil.copy(self.fixture("steady.stgs"), self.path("scene.stgs"))
        fast = ["--iterations", "5", "--preset", "fast"]
        cases = [("out.stgs", ["pack", "scene.stgs"]), ("out.ply", ["convert", "scene.stgs"]),
                 ("final.stgs", ["finalize", self.fixture("recorded.stgs")]),
                 ("trained.stgs", ["train", self.fixture("prepared"), *fast])]
        names = {"out.png": None, "out.y4m": None, "out.mp4": "prepare", "out.exr": "exr", "out/": None}
        for name, feature in names.items():
            if feature is None or harness.built_in(feature):
                cases.append((name, self.render(name)[:-2]))
        for output, args in cases:
            with self.subTest(output=output):
                args += [output, "--time", "0"] if args[0] == "convert" else ["-o", output]
                left = self.leftovers_of(output.strip("/"))
                with open(left[0], "rb") as file, open(left[1] + "/lock", "rb") as lock:
                    fcntl.flock(file, fcntl.LOCK_EX)
                    fcntl.flock(lock, fcntl.LOCK_EX)
                    result = self.stgs(*args)
                    self.assertEqual(result.returncode, 0, result.stderr)
                    self.assertTrue(os.path.exists(left[0]) and os.path.exists(left[1] + "/inner"))
                result = self.succeeds(*args)  # checks that nothing is left
                self.assertEqual(result.stderr.count(b"left over from a run that was killed"), 2,
                                 result.stderr)

    def test_a_second_run_with_the_same_output_is_refused(self):
        shutil.copy(self.fixture("steady.stgs"), self.path("scene.stgs"))
        train = ["train", self.fixture("prepared"), "--iterations", "5", "--preset", "fast"]
        cases = [("out.stgs", ["pack", "scene.stgs", "-o", "out.stgs"]),
                 ("out.ply", ["convert", "scene.stgs", "out.ply", "--time", "0"]),
                 ("out.stgs", ["finalize", self.fixture("recorded.stgs"), "-o", "out.stgs"]),
                 ("out.stgs", [*train, "-o", "out.stgs"]),
                 ("log.jsonl", [*train, "-o", "out.stgs", "--log", "log.jsonl"]),
                 ("report", [*train, "-o", "out.stgs", "--report", "report/"]),
                 ("out.png", self.render("out.png")),
                 ("frames", self.render("frames/"))]
        if harness.built_in("prepare"):
            encode = ["encode", harness.sample(), "-o", "out.stgs", "--frames", "0:2"]
            cases += [("out.stgs", encode), ("work", [*encode, "--keep-work", "work"])]
        for output, args in cases:
            with self.subTest(output=output, verb=args[0]):
                with open(self.path(f".{output}.lock"), "wb") as lock:
                    fcntl.flock(lock, fcntl.LOCK_EX)
                    self.fails(USAGE, f"{output}/?: another process is writing it", *args)
                    os.remove(lock.name)
                self.assertFalse(os.path.isfile(self.path(output)))
        self.assert_no_leftovers()

    def test_a_full_disk_leaves_no_part_of_a_report(self):
        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (10000, 10000))  # more than an image
        args = ["train", self.fixture("prepared"), "--iterations", "5", "--preset", "fast", "-o",
                "out.stgs", "--report", "report"]
        result = self.stgs(*args, preexec_fn=limit)
        self.assertEqual(result.returncode, IO, result.stderr)
        self.assertIn(b"index.html: cannot write", result.stderr)
        self.assertEqual(os.listdir(self.path("report")), ["training.jsonl"])
        self.succeeds(*args)
        self.assertIn("index.html", os.listdir(self.path("report")))

    def test_links_in_a_folder_of_frames_are_not_followed(self):
        os.makedirs(self.path("frames"))
        os.makedirs(self.path("other"))
        os.symlink("../other", self.path("frames/c"))
        args = ["render", self.fixture("tiny.stgs"), "--cameras", self.fixture("prepared"),
                "--which", "c", "--frames", "0:1"]
        self.fails(IO, "frames/c: cannot open the folder: .*; links are not followed", *args, "-o",
                   "frames")
        self.assertEqual((os.listdir(self.path("frames")), os.listdir(self.path("other"))), (["c"], []))
        os.symlink("other", self.path("chosen"))  # a link that the user names is followed
        self.succeeds(*args, "-o", "chosen")
        self.assertEqual(os.listdir(self.path("other/c")), ["000000.png"])

    def test_a_pipe_is_rejected_as_an_image(self):
        for name in ("pipe.png", *(["pipe.exr"] if harness.built_in("exr") else [])):
            os.mkfifo(self.path(name))
            self.fails(IO, f"{name}: not a regular file", "compare", name, name)

    def test_full_standard_output_is_an_error(self):
        with open("/dev/full", "wb") as full:
            self.fails(IO, "standard output: cannot write: No space left", "info",
                       self.fixture("tiny.stgs"), stdout=full)
            self.fails(IO, "standard output: cannot write: No space left",
                       *self.render("-", "--size", "320x240"), stdout=full)

    def test_closed_standard_streams_do_not_become_outputs(self):
        args = self.render("out.y4m", "--size", "64x64", "--progress", "json")
        self.succeeds(*args)
        expected = self.read("out.y4m")
        shell = ["sh", "-c", '"$@" <&- >&- 2>&-; echo $?', "sh", harness.STGS, *args]
        result = subprocess.run(shell, cwd=self.work, capture_output=True, check=True)
        self.assertEqual(result.stdout, b"2\n")  # the report could not be written
        self.assertEqual(self.read("out.y4m"), expected)

    def test_a_closed_pipe_is_an_error(self):
        read, write = os.pipe()
        os.close(read)
        with os.fdopen(write, "wb") as pipe:
            self.fails(IO, "standard output: cannot write: Broken pipe",
                       *self.render("-", "--size", "320x240"), stdout=pipe)

    def test_existing_outputs_are_replaced(self):
        self.write("out.png", b"old")
        self.succeeds(*self.render("out.png"))
        self.assertTrue(self.read("out.png").startswith(b"\x89PNG"))
        self.succeeds(*self.render("frames/"))
        self.write("frames/000000.png", b"old")
        self.write("frames/notes.txt", b"mine")
        self.succeeds(*self.render("frames/"))
        self.assertTrue(self.read("frames/000000.png").startswith(b"\x89PNG"))
        self.assertEqual(self.read("frames/notes.txt"), b"mine")


if __name__ == "__main__":
    unittest.main()
