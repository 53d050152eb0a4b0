# SPDX-License-Identifier: Apache-2.0
"""The protocols of the paper in prepare and evaluate."""
import json
import pathlib
import shutil

from harness import CliTest, built_in

USAGE, INVALID = 1, 3


class Protocols(CliTest):
    def extended(self):
        """A capture of selfcap: cameras 00 to 09 with 60 frames, which repeat those of the fixture."""
        source = pathlib.Path(self.fixture("prepared"))
        folder = pathlib.Path(self.path("selfcap"))
        capture = json.loads((source / "capture.json").read_text())
        cameras = []
        for number in range(10):
            camera = capture["cameras"][number % len(capture["cameras"])]
            frames = sorted((source / "frames" / camera["name"]).glob("*"))
            (folder / "frames" / f"{number:02}").mkdir(parents=True)
            for frame in range(60):
                shutil.copy(frames[frame % len(frames)],
                            folder / "frames" / f"{number:02}" / f"{frame:06}{frames[0].suffix}")
            cameras.append({**camera, "name": f"{number:02}", "test": number == 9})
        for points in ("points_static.ply", "points_dynamic.ply"):
            shutil.copy(source / points, folder)
        capture.update(frames=60, protocol="selfcap", source="easyvolcap", cameras=cameras)
        (folder / "capture.json").write_text(json.dumps(capture))
        return str(folder), "09"

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

    def test_unknown_protocols_of_a_capture_are_refused(self):
        folder = pathlib.Path(self.copy_capture("other"))
        capture = json.loads((folder / "capture.json").read_text())
        for name in ("n3d", "x" * 5000, 3, None):
            (folder / "capture.json").write_text(json.dumps({**capture, "protocol": name}))
            self.fails(INVALID, "capture.json", "evaluate", self.fixture("tiny.stgs"), "--against",
                       str(folder))

    def test_prepare_refuses_what_contradicts_a_protocol(self):
        if not built_in("prepare"):
            self.skipTest("prepare is not built in")
        for option in (("--frames", "0:3"), ("--test-cameras", "none"), ("--layout", "videos")):
            self.fails(USAGE, "--protocol", "prepare", "capture", "-o", "out", "--protocol", "n3dv",
                       *option)
        self.fails(USAGE, r"--scale 0.25: the images of protocol selfcap have the scale 0.5, or 1",
                   "prepare", "capture", "-o", "out", "--protocol", "selfcap", "--scale", "0.25")
