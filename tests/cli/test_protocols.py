# SPDX-License-Identifier: Apache-2.0
"""The protocols of the paper in prepare and evaluate."""
import json
import pathlib
import shutil

from harness import CliTest, built_in

USAGE, IO = 1, 2


class Protocols(CliTest):
    def extended(self):
        """A copy of the prepared fixture with the 60 frames of selfcap."""
        folder = pathlib.Path(self.copy_capture("selfcap"))
        capture = json.loads((folder / "capture.json").read_text())
        for camera in capture["cameras"]:
            for kind in ("frames", "masks"):
                files = sorted((folder / kind / camera["name"]).glob("*"))
                for number in range(len(files), 60 if files else 0):
                    copy = files[number % len(files)]
                    shutil.copy(copy, copy.with_stem(f"{number:06}"))
        capture.update(frames=60, protocol="selfcap")
        (folder / "capture.json").write_text(json.dumps(capture))
        return str(folder), next(c["name"] for c in capture["cameras"] if c["test"])

    def test_a_row_of_the_table(self):
        folder, camera = self.extended()
        self.succeeds("train", folder, "-o", "a.stgs", "--iterations", "2", "--num-evals", "0")
        evaluate = ("evaluate", "a.stgs", "--against", folder, "--protocol", "selfcap")
        result = self.json_of(*evaluate)
        self.assertEqual((result["protocol"], result["images"]), ("selfcap", 60))
        self.assertEqual([view["camera"] for view in result["views"]], [camera])
        text = self.succeeds(*evaluate).stdout.decode()
        self.assertIn(f"protocol selfcap: camera {camera}, 60 images: psnr {result['psnr']:.2f} dB, "
                      f"ssim_2 {result['ssim_2']:.4f}, no lpips (--lpips)\n", text)
        self.fails(USAGE, "excludes|cannot be|together", *evaluate, "--every", "2")
        self.fails(USAGE, "but by selfcap", "evaluate", "a.stgs", "--against", folder,
                   "--protocol", "n3dv")

    def test_captures_of_no_protocol_are_refused(self):
        self.fails(USAGE, "was not prepared by protocol n3dv .but without one.; prepare it with",
                   "evaluate", self.fixture("tiny.stgs"), "--against", self.fixture("prepared"),
                   "--protocol", "n3dv")

    def test_prepare_refuses_what_contradicts_a_protocol(self):
        if not built_in("prepare"):
            self.skipTest("prepare is not built in")
        for option in (("--frames", "0:3"), ("--test-cameras", "none"), ("--layout", "videos")):
            self.fails(USAGE, "--protocol", "prepare", "capture", "-o", "out", "--protocol", "n3dv",
                       *option)
        self.fails(USAGE, r"--scale 0.25: the images of protocol selfcap have the scale 0.5, or 1",
                   "prepare", "capture", "-o", "out", "--protocol", "selfcap", "--scale", "0.25")
