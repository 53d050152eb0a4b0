# SPDX-License-Identifier: Apache-2.0
"""Verbs reject an output name with the suffix of another format before they start work."""
import os
import unittest

from harness import CliTest

USAGE = 1


class OutputNames(CliTest):
    def test_verbs_that_write_a_scene_reject_other_suffixes(self):
        tiny, prepared = self.fixture("tiny.stgs"), self.fixture("prepared")
        for verb in (["pack", tiny], ["finalize", tiny], ["train", prepared], ["encode", prepared]):
            for name in ("x.mp4", "x.PNG", "x.ply", "x.json", "./a.b/x.webm"):
                with self.subTest(verb=verb[0], name=name):
                    self.fails(USAGE, rf"{name}: {verb[0]} writes a \.stgs file; use a name that "
                                      r"ends in \.stgs", *verb, "-o", name)
        self.fails(USAGE, r"\.stgs \('stgs render' writes video\)$", "train", prepared, "-o", "x.mp4")
        self.fails(USAGE, r"\.stgs \('stgs convert' writes other", "pack", tiny, "-o", "x.ply")
        self.assertEqual(os.listdir(self.work), [])

    def test_verbs_that_write_a_folder_reject_file_names(self):
        prepared = self.fixture("prepared")
        self.fails(USAGE, r"x.stgs: prepare writes a folder, not a \.stgs file; use another name",
                   "prepare", prepared, "-o", "x.stgs")
        self.fails(USAGE, r"x.mp4/: prepare writes a folder, not a \.mp4 file", "prepare", prepared,
                   "-o", "x.mp4/")
        self.assertEqual(os.listdir(self.work), [])

    def test_unknown_suffixes_are_accepted(self):
        for name in ("x.stgs", "x", "x.v2", "x.STGS"):
            self.succeeds("pack", self.fixture("tiny.stgs"), "-o", name)
            self.assertTrue(os.path.exists(self.path(name)))


if __name__ == "__main__":
    unittest.main()
