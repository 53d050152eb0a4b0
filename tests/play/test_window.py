#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`stgs play` in windows on a virtual display: it shows the same frames as `stgs render`, from files
and from nginx, and it stays responsive if a server does not answer.

usage: test_window.py STGS MAKE_PLAY_SCENE     exit code 77: a required program is missing
"""
import json
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path += [os.path.join(HERE, "..", "fetch"), HERE]
import jsonschema  # noqa: E402
from display import Display  # noqa: E402
from nginx import Nginx  # noqa: E402

WIDTH, HEIGHT = 640, 480
SCENE_AREA = "620:240:10:160"  # below the statistics and above the controls
CONTROLS_AREA = "640:60:0:420"
STGS = MAKE = DISPLAY = ""


class WindowTest(unittest.TestCase):
    def setUp(self):
        self.work = tempfile.mkdtemp(prefix="stgs-play-")
        self.addCleanup(shutil.rmtree, self.work, True)
        subprocess.run([MAKE, self.path("scene.stgs")], check=True)

    def path(self, name):
        return os.path.join(self.work, name)

    def run_stgs(self, *args, environment=None):
        return subprocess.run([STGS, *map(str, args)], cwd=self.work, timeout=200, check=False,
                              env=environment or DISPLAY.environment, capture_output=True, text=True)

    def play(self, *args, location=None):
        """Returns play's report, after checking that neither play nor Vulkan's validation layer
        printed a message."""
        result = self.run_stgs("play", location or "scene.stgs", "--size", f"{WIDTH}x{HEIGHT}",
                               "--format", "json", "--log-level", "debug", *args)
        self.assertEqual((result.returncode, result.stderr), (0, ""))
        report = json.loads(result.stdout)
        with open(os.path.join(HERE, "..", "..", "tools", "schema", "play.json"),
                  encoding="utf-8") as schema:
            jsonschema.validate(report, json.load(schema))
        self.assertEqual((report["width"], report["height"]), (WIDTH, HEIGHT))
        return report

    def render(self, report, name):
        """Renders the time and camera of a report with `stgs render`."""
        with open(self.path("camera.json"), "w", encoding="ascii") as file:
            json.dump(report["camera"], file)
        result = self.run_stgs("render", "scene.stgs", "--time", report["seconds"], "--camera",
                               "camera.json", "--backend", "cpu", "-o", name)
        self.assertEqual(result.returncode, 0, result.stderr)

    def crop(self, name, area):
        out = f"crop-{name}"
        subprocess.run(["ffmpeg", "-loglevel", "error", "-y", "-i", self.path(name), "-vf",
                        f"format=rgb24,crop={area}", self.path(out)], check=True)
        return out

    def differs(self, a, b, min_psnr=50):
        result = self.run_stgs("compare", a, b, "--min-psnr", min_psnr)
        self.assertIn(result.returncode, (0, 7), result.stderr)
        return result.returncode == 7

    def assert_shown_as_rendered(self, report):
        self.render(report, "expected.png")
        crops = [self.crop(name, SCENE_AREA) for name in ("window.png", "expected.png")]
        self.assertFalse(self.differs(*crops))

    def test_a_paused_scene_shows_the_frame_of_its_time(self):
        report = self.play("--time", 1.3, "--paused", "--no-overlay", "--screenshot", "window.png")
        self.assertEqual(report["seconds"], 1.3)
        result = self.run_stgs("render", "scene.stgs", "--time", 1.3, "--size",
                               f"{WIDTH}x{HEIGHT}", "--backend", "cpu", "-o", "expected.png")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertFalse(self.differs("window.png", "expected.png"))

    def test_controls_cover_a_playing_scene(self):
        report = self.play("--loop", "--after", 12, "--screenshot", "window.png")
        self.assertGreaterEqual(report["frames_shown"], 12)
        self.assertGreater(report["seconds"], 0)
        self.assert_shown_as_rendered(report)
        controls = [self.crop(name, CONTROLS_AREA) for name in ("window.png", "expected.png")]
        self.assertTrue(self.differs(*controls, min_psnr=30))

    def test_the_last_frame_is_shown(self):
        report = self.play("--time", 2.98, "--after", 5, "--no-overlay", "--screenshot",
                           "window.png")
        self.assertAlmostEqual(report["seconds"], 89 / 30)
        self.render(report, "expected.png")
        self.assertFalse(self.differs("window.png", "expected.png"))

    def count_bright(self, name, area):
        """Returns the number of nearly white pixels in an area of an image."""
        done = subprocess.run(["ffmpeg", "-loglevel", "error", "-i", self.path(name), "-vf",
                               f"format=gray,crop={area}", "-f", "rawvideo", "-"],
                              capture_output=True, check=True)
        return sum(value > 230 for value in done.stdout)

    def test_the_first_screenshot_contains_the_statistics(self):
        self.play("--time", 1.3, "--paused", "--screenshot", "window.png")
        self.play("--time", 1.3, "--paused", "--no-overlay", "--screenshot", "bare.png")
        bright = [self.count_bright(name, "300:110:8:8") for name in ("window.png", "bare.png")]
        self.assertGreater(bright[0], bright[1] + 1000)

    def test_a_scene_plays_backwards_from_another_camera(self):
        camera = {"width": WIDTH, "height": HEIGHT, "fx": 500, "fy": 510, "cx": 320, "cy": 240,
                  "rotation": [0.8, 0, -0.6, 0, 1, 0, 0.6, 0, 0.8], "translation": [3, 0.1, 0.5]}
        with open(self.path("start.json"), "w", encoding="ascii") as file:
            json.dump(camera, file)
        report = self.play("--start-camera", "start.json", "--time", 2.5, "--rate", -1, "--after",
                           8, "--screenshot", "window.png")
        self.assertLess(report["seconds"], 2.5)
        for key in ("fx", "fy", "cx", "cy", "rotation"):
            self.assertEqual(report["camera"][key], camera[key])
        self.assert_shown_as_rendered(report)

    def test_a_scene_on_a_server_plays(self):
        with Nginx(self.work) as server:
            report = self.play("--loop", "--after", 8, "--screenshot", "window.png",
                               location=server.url)
        self.assertGreater(report["seconds"], 0)
        self.assert_shown_as_rendered(report)

    def test_intact_segments_of_a_damaged_scene_are_shown(self):
        with open(self.path("scene.stgs"), "rb") as file:
            data = bytearray(file.read())
        for offset in range(len(data) // 2, len(data) // 2 + 200):
            data[offset] ^= 0xff
        with open(self.path("scene.stgs"), "wb") as file:
            file.write(data)
        result = self.run_stgs("play", "scene.stgs", "--time", 1.3, "--paused", "--no-overlay",
                               "--size", f"{WIDTH}x{HEIGHT}", "--screenshot", "window.png",
                               "--format", "json")
        self.assertEqual(result.returncode, 4, result.stderr)
        self.assertIn("damaged, skipped", result.stderr)
        self.assertIn("scene.stgs at 1.3 s: the screenshot is incomplete", result.stderr)
        self.render(json.loads(result.stdout), "expected.png")
        self.assertFalse(self.differs("window.png", "expected.png"))

    def start(self, *args):
        process = subprocess.Popen([STGS, "play", *args, "--format", "json"], cwd=self.work,
                                   env=DISPLAY.environment, stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, text=True)
        self.process = process
        self.addCleanup(process.communicate)
        self.addCleanup(process.kill)
        return process

    def xdotool(self, *args):
        return subprocess.run(["xdotool", *map(str, args)], env=DISPLAY.environment, check=False,
                              capture_output=True, text=True)

    def window_of(self, name):
        """Waits for a window, moves the mouse into it, and returns its id. Without a window
        manager, keys go to the window under the mouse."""
        for _ in range(1000):
            found = self.xdotool("search", "--name", name).stdout.split()
            if found:
                self.xdotool("mousemove", "--window", found[0], 300, 200)
                return found[0]
            time.sleep(0.05)
        self.fail(f"no window '{name}'; exit code {self.process.poll()}, windows "
                  + self.xdotool("search", "--name", ".").stdout)

    def test_keys_and_mouse_step_drag_and_take_screenshots(self):
        process = self.start("scene.stgs", "--size", f"{WIDTH}x{HEIGHT}", "--paused")
        self.window_of("random scene")
        for _ in range(3):
            self.xdotool("key", "Right")
        self.xdotool("key", "p")
        self.wait_for("stgs-001.png")  # the scene is shown and can be dragged
        self.xdotool("mousedown", 1)
        for _ in range(5):
            self.xdotool("mousemove_relative", 20, 4)
        self.xdotool("mouseup", 1, "key", "F1", "key", "p")
        self.wait_for("stgs-002.png")
        self.xdotool("key", "Escape")
        out, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 0, error)
        report = json.loads(out)
        self.assertAlmostEqual(report["seconds"], 3 / 30)
        # All 100 pixels count, even if few frames were rendered meanwhile.
        angle = 2 * math.pi * 100 / HEIGHT
        self.assertAlmostEqual(abs(report["camera"]["rotation"][2]), math.sin(angle), places=3)
        self.render(report, "expected.png")
        self.assertFalse(self.differs("stgs-002.png", "expected.png"))

    def wait_for(self, name):
        for _ in range(1000):
            if os.path.exists(self.path(name)):
                return
            time.sleep(0.05)
        self.fail(f"no {name}")

    def after(self, *steps, time_of=1.5, size="400x300"):
        """Returns play's report of a scene that starts paused, after `steps`: xdotool commands, and
        delays in seconds."""
        process = self.start("scene.stgs", "--size", size, "--paused", "--time", str(time_of))
        self.window_of("random scene")
        self.xdotool("key", "p")
        self.wait_for("stgs-001.png")  # the scene is shown
        for step in steps:
            if isinstance(step, float):
                time.sleep(step)
            else:
                self.assertEqual(self.xdotool(*step.split()).returncode, 0, step)
        self.xdotool("key", "Escape")
        out, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 0, error)
        os.remove(self.path("stgs-001.png"))
        return json.loads(out)

    def test_keys_seek(self):
        frame = 1 / 30
        steps = self.after("key Left Left shift+Right")
        self.assertAlmostEqual(steps["seconds"], 2.5 - 2 * frame, places=5)
        self.assertEqual(self.after("key Home")["seconds"], 0)
        self.assertAlmostEqual(self.after("key End")["seconds"], 3, delta=frame)

    def test_keys_pause_and_set_the_rate(self):
        slow = ["key Down"] * 2 + ["key space", 0.5]  # a quarter of the speed: the end is 6 s away
        self.assertTrue(1.5 < self.after(*slow)["seconds"] < 3)
        faster = ["key Down"] * 8 + ["key Up"] * 12 + ["key space", 1.0]  # forwards again
        self.assertAlmostEqual(self.after(*faster, time_of=2.7)["seconds"], 3, delta=1 / 30)
        backwards = ["key Down"] * 8 + ["key space", 1.0]
        self.assertEqual(self.after(*backwards, time_of=0.3)["seconds"], 0)
        self.assertLess(self.after("key l", "key space", 0.7, time_of=2.9)["seconds"], 2.9)

    def test_the_mouse_seeks_in_the_timeline(self):
        begin = f"mousemove {round(0.75 * WIDTH)} {HEIGHT - 41}"  # the window is at 0, 0
        seconds = self.after(begin, 0.5, "mousedown 1", 0.5, "mouseup 1", 0.5,
                             size=f"{WIDTH}x{HEIGHT}")["seconds"]
        self.assertAlmostEqual(seconds, 0.75 * 3, delta=0.1)

    def test_keys_and_wheel_move_the_camera_and_r_resets_it(self):
        start = self.after()["camera"]
        all_moves = []
        for moves in (["keydown w", 0.4, "keyup w"], ["click 4", 0.3], ["keydown d", 0.4, "keyup d"]):
            camera = self.after(*moves)["camera"]
            self.assertEqual(camera["rotation"], start["rotation"], moves)
            self.assertNotEqual(camera["translation"], start["translation"], moves)
            all_moves += moves
        self.assertEqual(self.after(*all_moves, 0.3, "key r", 0.3)["camera"], start)

    def test_a_window_can_be_resized(self):
        process = self.start("scene.stgs", "--paused", "--no-overlay", "--log-level", "debug")
        window = self.window_of("random scene")
        for i, (width, height) in enumerate([(500, 300), (1, 1), (301, 477)], 1):
            self.xdotool("windowsize", "--sync", window, width, height)
            time.sleep(0.3)
            self.xdotool("key", "--window", window, "p")
            self.wait_for(f"stgs-{i:03}.png")
        time.sleep(0.3)  # until the file is complete
        self.xdotool("key", "--window", window, "Escape")
        out, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 0, error)
        self.assertNotIn("alidation", error)
        report = json.loads(out)
        self.assertEqual((report["width"], report["height"]), (301, 477))
        self.render(report, "expected.png")
        self.assertFalse(self.differs("stgs-003.png", "expected.png"))

    def test_only_arrow_keys_repeat(self):
        process = self.start("scene.stgs", "--size", f"{WIDTH}x{HEIGHT}", "--paused")
        self.window_of("random scene")
        for key in ("p", "Right"):
            self.xdotool("keydown", key)
            time.sleep(1.2)
            self.xdotool("keyup", key)
        self.wait_for("stgs-001.png")
        self.xdotool("key", "Escape")
        out, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 0, error)
        self.assertGreater(json.loads(out)["seconds"], 2 / 30)  # the display repeats keys
        self.assertFalse(os.path.exists(self.path("stgs-002.png")))

    def test_a_window_responds_while_its_server_does_not(self):
        with socket.socket() as server:
            server.bind(("127.0.0.1", 0))
            server.listen()
            process = self.start(f"http://127.0.0.1:{server.getsockname()[1]}/scene.stgs")
            self.window_of("stgs play")
            time.sleep(0.5)
            begin = time.monotonic()
            self.xdotool("key", "Escape")
            _, error = process.communicate(timeout=60)
            self.assertEqual(process.returncode, 0, error)
            self.assertLess(time.monotonic() - begin, 8)  # connections time out after 10 s

    def test_a_missing_server_is_retried_and_reported(self):
        with socket.socket() as closed:
            closed.bind(("127.0.0.1", 0))  # reserves the port without listening
            process = self.start(f"http://127.0.0.1:{closed.getsockname()[1]}/scene.stgs")
            _, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 2, error)
        self.assertIn("retrying", error.split("stgs: error:")[0])

    def test_closing_before_the_screenshot_is_an_error(self):
        process = self.start("scene.stgs", "--loop", "--after", "100000", "--screenshot",
                             "window.png")
        self.window_of("random scene")
        self.xdotool("key", "Escape")
        out, error = process.communicate(timeout=60)
        self.assertEqual((process.returncode, out), (4, ""))
        self.assertEqual(json.loads(error)["error"],
                         {"code": "runtime", "exit_code": 4, "path": "window.png", "issue": None,
                          "offset": None,
                          "message": "window.png: the window was closed before it was written"})
        self.assertFalse(os.path.exists(self.path("window.png")))

    def test_an_interrupt_ends_play(self):
        process = self.start("scene.stgs", "--loop")
        self.window_of("random scene")
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 4, error)
        self.assertIn("interrupted", error)

    def fails(self, code, message, *args, **changes):
        environment = dict(DISPLAY.environment, **changes)
        result = self.run_stgs("play", *args, environment=environment)
        self.assertEqual(result.returncode, code, result.stderr)
        self.assertRegex(result.stderr, f"^stgs: error: .*{message}")

    def test_errors_have_their_exit_codes(self):
        self.fails(5, "window", "scene.stgs", DISPLAY="")
        self.fails(5, "Vulkan", "scene.stgs", VK_ICD_FILENAMES="/nonexistent.json")
        self.fails(2, "missing.stgs", "missing.stgs")
        self.fails(2, "start.json", "scene.stgs", "--start-camera", "start.json")
        with open(self.path("broken.stgs"), "wb") as file:
            file.write(b"no scene at all" * 100)
        self.fails(3, "broken.stgs", "broken.stgs")
        self.fails(1, "out of range", "scene.stgs", "--time", "4")
        self.fails(1, "--rate 0", "scene.stgs", "--rate", "0")
        self.fails(1, ".png", "scene.stgs", "--screenshot", "window.jpg")
        self.fails(2, "nowhere", "scene.stgs", "--screenshot", "nowhere/window.png")


def main():
    global STGS, MAKE, DISPLAY
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    missing = [name for name in ("Xvfb", "xdotool", "ffmpeg", "nginx") if shutil.which(name) is None]
    if missing:
        print("skipped: needs", ", ".join(missing))
        sys.exit(77)
    STGS, MAKE = map(os.path.abspath, sys.argv[1:3])
    with Display() as DISPLAY:
        unittest.main(argv=sys.argv[:1] + sys.argv[3:], verbosity=2)


if __name__ == "__main__":
    main()
