# SPDX-License-Identifier: Apache-2.0
"""`stgs live`: a rig whose frames arrive as videos, growing folders, pipes and network streams."""
import json
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import unittest

import harness
from harness import CliTest, built_in
from rtsp_server import Media, RtspServer

USAGE, IO, INVALID, RUNTIME = 1, 2, 3, 4
CAMERAS, STREAMS, FRAMES = 4, 8, 20


def quick(*more):
    """Options for little work, with windows of eight frames."""
    return ["--scale", "0.2", "--latency", "0.1", "--max-primitives", "2000", "--threads", "2", *more]


@unittest.skipUnless(built_in("encode"), "encode is not built in")
class Live(CliTest):
    """Cameras of the sample capture."""

    @classmethod
    def setUpClass(cls):
        with tempfile.TemporaryDirectory(prefix="stgs-cli-") as folder:
            prepared = os.path.join(folder, "prepared")
            subprocess.run([harness.STGS, "prepare", harness.sample(), "-o", prepared, "--frames", "0:1", "--scale",
                            "0.1", "--test-cameras", "none", "--no-split"],
                           capture_output=True, check=True)
            with open(os.path.join(prepared, "capture.json"), encoding="utf-8") as file:
                capture = json.load(file)
        cls.names, cls.streams, cls.cameras = [], [], []
        for camera in capture["cameras"][:STREAMS]:
            scale, rotation, translation = 480 / camera["width"], camera["rotation"], camera["translation"]
            cls.streams.append(camera["name"])
            cls.cameras.append({
                "name": camera["name"], "width": 480, "height": 360,
                "K": [[camera["fx"] * scale, 0, camera["cx"] * scale],
                      [0, camera["fy"] * scale, camera["cy"] * scale], [0, 0, 1]],
                "w2c": [rotation[3 * i:3 * i + 3] + [translation[i]] for i in range(3)]})
        cls.names = cls.streams[:CAMERAS]

    def rig(self, sources, fps=10):
        """Writes rig.json with the source of each camera."""
        cameras = [dict(camera, source=source, test=False) for camera, source in zip(self.cameras, sources)]
        self.write("rig.json", json.dumps({"fps": fps, "cameras": cameras}))
        return "rig.json"

    def check(self, report, frames, cameras=CAMERAS):
        self.assertEqual(report["cameras"], cameras)
        self.assertEqual(report["frames"], frames)
        self.assertEqual(report["lost_frames"], 0)
        self.assertEqual(report["images"]["overflow"], 0)
        info = self.json_of("info", "out.stgs")
        self.assertEqual(info["frames"], frames)
        self.assertEqual(info["primitives"], report["primitives"])
        self.json_of("validate", "out.stgs")

    def test_videos_play_at_their_own_pace(self):
        for name in self.names:
            shutil.copy(os.path.join(harness.sample(), f"{name}.mp4"), self.work)
        self.rig([f"{name}.mp4" for name in self.names])
        begin = time.monotonic()
        report = self.json_of("live", "rig.json", "-o", "out.stgs", "--log", "log.jsonl", *quick())
        self.assertGreater(time.monotonic() - begin, (FRAMES - 1) / 10)
        self.check(report, FRAMES)
        self.assertEqual(report["images"]["received"], CAMERAS * FRAMES)
        # A busy machine may deliver some too late.
        self.assertLessEqual(report["images"]["missing"], CAMERAS * FRAMES // 4)
        with open(self.path("log.jsonl"), encoding="utf-8") as file:
            windows = [json.loads(line) for line in file]
        self.assertEqual(len(windows), report["windows"])
        self.assertEqual(sum(window["frames"] for window in windows), FRAMES)
        self.assertEqual(windows[0]["frames"], 8)
        self.assertGreater(windows[0]["psnr"], 12)
        self.assertGreater(report["psnr"], 12)
        self.assertEqual(windows[0]["scale"], 1)
        self.assertLessEqual(report["scale"], 1)
        self.assertEqual(sorted(os.listdir(self.work)),
                         sorted(["log.jsonl", "out.stgs", "rig.json", *(f"{name}.mp4" for name in self.names)]))

    def test_folders_grow_and_a_camera_stalls(self):
        images = {}
        for name in self.names:
            os.makedirs(self.path("images", name))
            os.makedirs(self.path("growing", name))
            subprocess.run(["ffmpeg", "-v", "error", "-i", os.path.join(harness.sample(), f"{name}.mp4"),
                            "-start_number", "0", self.path("images", name, "%06d.png")], check=True)
            images[name] = sorted(os.listdir(self.path("images", name)))
        self.rig([f"growing/{name}" for name in self.names])
        args = [harness.STGS, "live", "rig.json", "-o", "out.stgs", "--format", "json", *quick()]
        with subprocess.Popen(args, cwd=self.work, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            self.addCleanup(process.kill)
            lines = iter(process.stderr.readline, b"")  # others state that there is no GPU
            while b"Ctrl-C ends the recording" not in next(lines):
                pass
            time.sleep(0.5)  # images that exist at the start are left out
            begin = time.monotonic()
            for frame in range(FRAMES):
                time.sleep(max(0.0, begin + frame / 10 - time.monotonic()))
                for name in self.names:
                    if name == self.names[1] and frame == 12:
                        continue  # this camera misses a frame
                    image = images[name][frame]
                    shutil.copy(self.path("images", name, image), self.path("growing", name, image))
            time.sleep(0.5)
            process.send_signal(signal.SIGINT)  # without it, it ends after ten seconds without an image
            output, error = process.communicate(timeout=120)
        self.assertEqual(process.returncode, 0, error)
        report = json.loads(output)
        self.check(report, FRAMES)
        self.assertGreaterEqual(report["images"]["missing"], 1)

    def senders(self, names, loops, url_of, *options):
        """Sends the video of each camera several times, at its own pace, to its address."""
        out = []
        for i, name in enumerate(names):
            out.append(subprocess.Popen(
                ["ffmpeg", "-v", "error", "-re", "-stream_loop", str(loops), "-i", os.path.join(harness.sample(), f"{name}.mp4"), *options,
                 "-f", "mpegts", url_of(i)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL))

        def end():
            for process in out:
                process.kill()
                process.wait()

        self.addCleanup(end)
        return out

    def test_named_pipes_and_their_end(self):
        paths = [self.path(f"{name}.pipe") for name in self.names]
        for path in paths:
            os.mkfifo(path)
        self.rig([f"{name}.pipe" for name in self.names], fps=30)
        args = [harness.STGS, "live", "rig.json", "-o", "out.stgs", "--format", "json", *quick()]
        with subprocess.Popen(args, cwd=self.work, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            senders = self.senders(self.names, 4, lambda i: f"file:{paths[i]}", "-y", "-c", "copy")
            output, error = process.communicate(timeout=120)
            for sender in senders:
                sender.wait(30)
        self.assertEqual(process.returncode, 0, error)
        report = json.loads(output)
        self.assertEqual(report["cameras"], CAMERAS)
        self.assertGreaterEqual(report["images"]["received"], 3 * CAMERAS * FRAMES)
        self.assertGreaterEqual(self.json_of("info", "out.stgs")["frames"], 8)

    def record_until_ctrl_c(self, cameras, started=lambda: None, is_complete=lambda: True):
        """Runs `live` until its recording, which can be read while it grows, has eight frames and `is_complete`
        returns true. Returns what it logs."""
        args = [harness.STGS, "live", "rig.json", "-o", "out.stgs", "--format", "json", *quick()]
        with open(self.path("stderr.txt"), "wb") as error:
            process = subprocess.Popen(args, cwd=self.work, stdout=subprocess.PIPE, stderr=error)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        started()
        deadline, frames = time.monotonic() + 60, 0
        while (frames < 8 or not is_complete()) and time.monotonic() < deadline:
            time.sleep(0.2)
            info = self.stgs("info", "out.stgs", "--format", "json")
            if info.returncode == 0:
                frames = json.loads(info.stdout)["frames"]
        self.assertGreaterEqual(frames, 8, self.read("stderr.txt"))
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=60)
        log = self.read("stderr.txt").decode()
        self.assertEqual(process.returncode, 0, log)
        report = json.loads(output)
        self.assertEqual(report["cameras"], cameras)
        self.assertEqual(self.json_of("info", "out.stgs")["frames"], report["frames"])
        return log

    def test_network_streams_until_ctrl_c(self):
        ports = []
        for _ in self.streams:  # free ones
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind(("127.0.0.1", 0))
                ports.append(probe.getsockname()[1])
        self.rig([f"udp://127.0.0.1:{port}" for port in ports])
        self.record_until_ctrl_c(STREAMS, lambda: self.senders(
            self.streams, 30, lambda i: f"udp://127.0.0.1:{ports[i]}?pkt_size=1316", "-r", "10", "-c:v",
            "mpeg2video", "-g", "1"))

    def test_rtsp_streams_of_which_one_breaks_off(self):
        media = {}
        for name in self.names:
            media[name] = Media(os.path.join(harness.sample(), f"{name}.mp4"), 10, self.path(f"{name}.sdp"))
            self.addCleanup(media[name].close)
        broken = media[self.names[1]]
        broken.cut_after = 40
        with RtspServer(media) as server:
            self.rig([server.url(name) for name in self.names])
            log = self.record_until_ctrl_c(CAMERAS, is_complete=lambda: broken.plays == 2)
        self.assertEqual([media[name].plays for name in self.names], [1, 2, 1, 1])
        self.assertIn(f"camera '{self.names[1]}': stream lost", log)

    def test_a_stream_that_does_not_fit_its_calibration_ends_its_camera(self):
        media = {}
        for name in self.names:
            media[name] = Media(os.path.join(harness.sample(), f"{name}.mp4"), 10, self.path(f"{name}.sdp"))
            self.addCleanup(media[name].close)
        with RtspServer(media) as server:
            path = self.path(self.rig([server.url(name) for name in self.names]))
            with open(path, encoding="utf-8") as file:
                rig = json.load(file)
            rig["cameras"][0]["height"] = 200
            self.write("rig.json", json.dumps(rig))
            log = self.record_until_ctrl_c(CAMERAS - 1)
        self.assertEqual(media[self.names[0]].plays, 1)
        self.assertIn(f"camera '{self.names[0]}' do not match the aspect ratio", log)

    def test_mistakes(self):
        rig = self.rig(["missing.mp4"] * CAMERAS)
        self.write("exists.stgs", "x")
        self.fails(USAGE, "exists.stgs: exists", "live", rig, "-o", "exists.stgs")
        self.fails(USAGE, "expected 0.1 to 1000", "live", rig, "-o", "a.stgs", "--fps", "5000")
        self.fails(IO, "no such file", "live", "none", "-o", "a.stgs")
        self.fails(IO, "missing.mp4: not found", "live", rig, "-o", "a.stgs")
        for source, code, message in ((f"file://{harness.sample()}/cam00.mp4", USAGE, "unknown scheme"),
                                      ("../outside", INVALID, "outside"), ("", USAGE, 'add "source"')):
            self.fails(code, message, "live", self.rig([source] * CAMERAS), "-o", "a.stgs")
        self.write("one.json", json.dumps({"fps": 10, "cameras": self.cameras[:1]}))
        self.fails(INVALID, "expected at least 2", "live", "one.json", "-o", "a.stgs")
        self.write("slow.json", json.dumps(self.cameras))
        self.fails(USAGE, "set --fps", "live", "slow.json", "-o", "a.stgs")
        self.write("broken.json", "{")
        self.fails(INVALID, "broken.json", "live", "broken.json", "-o", "a.stgs")
        shutil.copytree(harness.sample(), self.path("late"))
        self.write("late/timing.json", '{"cam00": {"time_offset": 0.01}}')
        self.fails(USAGE, "late: has timing.json", "live", "late", "-o", "a.stgs")
        os.makedirs(self.path("timed"))
        self.write("timed/timing.json", "{}")
        shutil.copy(self.path(rig), self.path("timed", "cameras.json"))
        self.fails(USAGE, "timed: has timing.json", "live", "timed", "-o", "a.stgs")
        # Pipes without writers wait; Ctrl-C ends them.
        for name in self.names:
            os.mkfifo(self.path(f"{name}.pipe"))
        rig = self.rig([f"{name}.pipe" for name in self.names])
        with subprocess.Popen([harness.STGS, "live", rig, "-o", "a.stgs"], cwd=self.work,
                              stderr=subprocess.PIPE) as process:
            time.sleep(1)
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=30)
        self.assertEqual(process.returncode, RUNTIME, error)
        self.assertIn(b"fewer than 2 cameras have delivered a frame", error)
        self.assertFalse([name for name in os.listdir(self.work) if "a.stgs" in name])


if __name__ == "__main__":
    unittest.main()
