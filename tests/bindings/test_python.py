#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The Python module: scenes, players, images in NumPy arrays, primitives, errors, threads.

usage: test_python.py FIXTURE_PROGRAM STGS [unittest arguments], with the module on PYTHONPATH
"""
import copy
import gc
import logging
import math
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import numpy as np

import stgs

FIXTURE_PROGRAM, STGS = sys.argv[1:3]
FOLDER = tempfile.mkdtemp()


def path(name):
    return os.path.join(FOLDER, name)


def content(name):
    with open(path(name), "rb") as file:
        return file.read()


class Scenes(unittest.TestCase):
    def fails(self, name, call):
        with self.assertRaises(stgs.Error) as caught:
            call()
        self.assertEqual(caught.exception.name, name)
        return caught.exception

    def test_scenes_describe_their_file(self):
        scene = stgs.Scene(path("tiny.stgs"))
        info = scene.info
        self.assertEqual(scene.title, "fixture")
        self.assertEqual((info.frames, info.primitives, info.sh_degree), (6, 400, 1))
        self.assertEqual(info.format[0], 2)
        self.assertAlmostEqual(info.duration_seconds, 6 / info.fps)
        self.assertEqual(info.file_bytes, os.path.getsize(path("tiny.stgs")))
        self.assertTrue(all(low < high for low, high in zip(info.bounds_min, info.bounds_max)))
        self.assertEqual(scene.issues, [])
        self.assertTrue(info.has_start_camera)

    def test_buffers_are_borrowed(self):
        expected = stgs.Scene(path("tiny.stgs")).primitives(0.1).position
        file = content("tiny.stgs")
        for source in file, bytearray(file), memoryview(file), np.frombuffer(file, np.uint8):
            scene = stgs.Scene(source)
            np.testing.assert_array_equal(scene.primitives(0.1).position, expected)
        borrowed = bytearray(file)
        scene = stgs.Scene(borrowed)
        with self.assertRaises(BufferError):
            borrowed.clear()
        del scene
        gc.collect()
        borrowed.clear()
        with self.assertRaises(BufferError):
            stgs.Scene(memoryview(file)[::2])

    def test_errors_have_code_message_and_offset(self):
        error = self.fails("STGS_ERROR_IO", lambda: stgs.Scene(path("no such file")))
        self.assertEqual((error.code, error.offset, error.issue), (20, None, 0))
        self.assertIn("no such file", str(error))
        error = self.fails("STGS_ERROR_INVALID_FILE",
                           lambda: stgs.Scene(content("tiny.stgs")[:-1], reject_damage=True))
        self.assertGreater(error.issue, 0)
        self.assertIsInstance(error.offset, int)
        tiny = path("tiny.stgs")
        self.fails("STGS_ERROR_LIMIT", lambda: stgs.Scene(tiny, max_primitives=10))
        self.fails("STGS_ERROR_ARGUMENT", lambda: stgs.Scene(tiny, max_memory=1))
        self.fails("STGS_ERROR_ARGUMENT", lambda: stgs.Scene(tiny, memory_budget=1))
        self.fails("STGS_ERROR_UNSUPPORTED", stgs.Scene(path("no_camera.stgs")).start_view)
        self.fails("STGS_ERROR_ARGUMENT", lambda: stgs.Renderer("paper"))
        self.fails("STGS_ERROR_ARGUMENT", lambda: stgs.Scene(tiny).primitives(math.nan))
        with self.assertRaises(TypeError):
            stgs.Scene(5)

    def test_framed_views_contain_the_complete_scene(self):
        scene = stgs.Scene(path("no_camera.stgs"))
        view = scene.first_view().resized(80, 45)
        alpha = stgs.Renderer("cpu").render(scene, 0.1, view, ["alpha"]).alpha
        self.assertGreater(np.mean(alpha > 0.5), 0.02)
        self.assertLess(np.mean(np.concatenate([alpha[0], alpha[-1]]) > 0.5), 0.2)
        np.testing.assert_array_equal(view.rotation, np.eye(3))
        view.translation[:] = 100, 100, 100
        again = scene.framed(view)
        np.testing.assert_array_equal(view.translation, 100)
        np.testing.assert_allclose(again.translation, scene.first_view().translation, rtol=0.1)
        view.fx = 0
        self.fails("STGS_ERROR_ARGUMENT", lambda: scene.framed(view))
        tiny = stgs.Scene(path("tiny.stgs"))
        np.testing.assert_array_equal(tiny.first_view().translation, tiny.start_view().translation)

    def test_messages_go_to_the_python_log(self):
        with self.assertLogs("stgs", logging.INFO) as log:
            stgs.Renderer("cpu")
        self.assertIn("cpu", log.output[0])

    def test_primitives_are_evaluated_at_a_time(self):
        scene = stgs.Scene(path("tiny.stgs"))
        primitives = scene.primitives(0.1)
        count = len(primitives)
        self.assertTrue(10 < count <= 400)
        shapes = {"id": (count,), "position": (count, 3), "velocity": (count, 3),
                  "scale": (count, 3), "rotation": (count, 4), "opacity": (count,),
                  "sh": (count, 4, 3)}
        for name, shape in shapes.items():
            self.assertEqual(getattr(primitives, name).shape, shape, name)
            self.assertTrue(np.isfinite(getattr(primitives, name)).all(), name)
        np.testing.assert_allclose(np.linalg.norm(primitives.rotation, axis=1), 1, atol=1e-5)
        self.assertTrue((primitives.opacity >= 1 / 255 - 1e-6).all() and (primitives.opacity <= 1).all())
        self.assertTrue((primitives.scale > 0).all())
        # They equal those that `stgs convert` writes.
        subprocess.run([STGS, "convert", path("tiny.stgs"), path("time.ply"), "--time", "0.1"],
                       check=True, capture_output=True)
        head, body = content("time.ply").split(b"end_header\n", 1)
        names = [line.split()[2].decode() for line in head.splitlines()
                 if line.startswith(b"property float")]
        table = np.frombuffer(body, "<f4").reshape(-1, len(names))
        self.assertEqual(len(table), count)
        columns = [names.index(name) for name in "xyz"]
        np.testing.assert_allclose(primitives.position, table[:, columns], atol=1e-5)
        # Primitives that are active at both times have moved by their velocity.
        later = scene.primitives(0.1 + 0.01)
        common, i, j = np.intersect1d(primitives.id, later.id, return_indices=True)
        self.assertGreater(len(common), 10)
        np.testing.assert_allclose(later.position[j],
                                   primitives.position[i] + 0.01 * primitives.velocity[i], atol=1e-4)


class Images(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scene = stgs.Scene(path("tiny.stgs"))
        cls.renderer = stgs.Renderer("cpu")
        cls.view = cls.scene.start_view()

    def test_an_image_has_the_requested_planes(self):
        self.assertEqual(self.renderer.backend, "cpu")
        image = self.renderer.render(self.scene, 0.1, self.view,
                                       ["rgba8", "rgb", "alpha", "depth"])
        self.assertEqual(image.rgba8.shape, (48, 64, 4))
        self.assertEqual(image.rgb.shape, (3, 48, 64))
        self.assertGreater(len(np.unique(image.rgba8)), 50)
        rounded = np.clip(np.moveaxis(image.rgb, 0, 2), 0, 1) * 255
        self.assertLess(np.abs(rounded - image.rgba8[..., :3]).max(), 0.51)
        self.assertTrue((image.depth[image.alpha > 0.5] > self.view.near_plane).all())
        self.assertTrue((image.depth[image.alpha == 0] == 0).all())
        alone = self.renderer.render(self.scene, 0.1, self.view)
        np.testing.assert_array_equal(alone.rgba8, image.rgba8)
        self.assertIsNone(alone.depth)

    def test_views_own_their_arrays(self):
        view = copy.copy(self.view)
        view.background[:] = (0, 1, 0)
        view.translation[2] = -1e6  # nothing is visible
        image = self.renderer.render(self.scene, 0.1, view, ["rgba8"])
        self.assertTrue((image.rgba8[..., :3] == (0, 255, 0)).all())
        self.assertEqual(self.view.background.tolist(), [0, 0, 0])
        small = self.view.resized(32, 24)
        self.assertEqual((small.width, small.height, small.fx), (32, 24, self.view.fx / 2))
        fovea = self.view.resized(256, 192)
        uniform = self.renderer.render(self.scene, 0.1, fovea).rgba8
        fovea.fovea_x, fovea.fovea_y, fovea.fovea_radius = 60, 50, 40
        foveated = self.renderer.render(self.scene, 0.1, fovea).rgba8
        np.testing.assert_array_equal(foveated[22:78, 32:88], uniform[22:78, 32:88])
        self.assertTrue((foveated[128:192:2] == foveated[129:192:2]).all())
        rotation = stgs.View().rotation  # the array keeps its view alive
        gc.collect()
        np.testing.assert_array_equal(rotation, np.eye(3))

    def test_images_are_rendered_into_arrays_of_the_caller(self):
        expected = self.renderer.render(self.scene, 0.1, self.view, ["rgba8", "depth"])
        both = np.zeros((48, 130, 4), np.uint8)  # two images side by side with a gap
        depth = np.full((48, 64), -1, np.float32)
        out = [stgs.Image(rgba8=both[:, :64], depth=depth), stgs.Image(rgba8=both[:, 66:])]
        images = self.renderer.render(self.scene, 0.1, [self.view, self.view], out=out)
        self.assertIs(images[0].depth, depth)
        np.testing.assert_array_equal(both[:, :64], expected.rgba8)
        np.testing.assert_array_equal(both[:, 66:], expected.rgba8)
        self.assertTrue((both[:, 64:66] == 0).all())
        np.testing.assert_array_equal(depth, expected.depth)

    def test_unsuitable_arrays_are_rejected(self):
        frozen = np.zeros((48, 64, 4), np.uint8)
        frozen.flags.writeable = False
        wrong = [np.zeros((48, 64, 3), np.uint8), np.zeros((47, 64, 4), np.uint8), frozen,
                 np.zeros((48, 64, 4), np.float32), np.zeros((48, 128, 4), np.uint8)[:, ::2],
                 np.zeros((48, 64, 4), np.uint8)[::-1], [1, 2]]
        for array in wrong:
            with self.assertRaises(ValueError):
                self.renderer.render(self.scene, 0.1, self.view, out=stgs.Image(rgba8=array))
        with self.assertRaises(ValueError):
            self.renderer.render(self.scene, 0.1, [self.view] * 2, out=[stgs.Image()])
        with self.assertRaises(ValueError):
            self.renderer.render(self.scene, 0.1, self.view, ["colour"])

    def test_invalid_views_are_rejected(self):
        mirrored = copy.copy(self.view)
        mirrored.rotation[0] *= -1
        huge = copy.copy(self.view)
        huge.width = 1 << 31
        for view in mirrored, huge, [], [self.view] * 5:
            with self.assertRaises(stgs.Error) as caught:
                self.renderer.render(self.scene, 0.1, view)
            self.assertEqual(caught.exception.name, "STGS_ERROR_ARGUMENT")

    def test_rendering_releases_the_interpreter_lock(self):
        view = self.view.resized(1280, 960)
        turns, started, done = [0], threading.Event(), threading.Event()

        def count():
            started.set()
            while not done.is_set():
                turns[0] += 1
                time.sleep(0)

        counter = threading.Thread(target=count)
        counter.start()
        started.wait()
        before = turns[0]
        self.renderer.render(self.scene, 0.1, view)
        meanwhile = turns[0] - before
        done.set()
        counter.join()
        # With the interpreter's lock held, there would be one or two turns.
        self.assertGreater(meanwhile, 5)

    def test_objects_may_be_shared_by_threads(self):
        expected = self.renderer.render(self.scene, 0.1, self.view).rgba8
        images = []

        def render():
            for _ in range(5):
                images.append(self.renderer.render(self.scene, 0.1, self.view).rgba8)
                len(self.scene.primitives(0.1))

        threads = [threading.Thread(target=render) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(images), 20)
        for image in images:
            np.testing.assert_array_equal(image, expected)


class Players(unittest.TestCase):
    def until(self, player, condition, seconds=60):
        """Updates the player in real time until its status meets a condition."""
        end = time.monotonic() + seconds
        while not condition(status := player.update()):
            self.assertLess(time.monotonic(), end)
            time.sleep(0.001)
        return status

    def test_a_clip_plays_to_its_end_and_loops(self):
        for source in path("tiny.stgs"), content("tiny.stgs"):
            player = stgs.Player(source, prefetch_seconds=5, max_reads_in_flight=2)
            player.wait_open()
            self.assertEqual([e.kind for e in player.events()], ["opened"])
            player.play()
            times = []
            while (status := player.update()).state != "ended":
                times.append(status.seconds)
            self.assertEqual(times, sorted(times))
            info = player.scene.info
            self.assertAlmostEqual(status.seconds, info.duration_seconds - 1 / info.fps)
            self.assertIn("ended", [e.kind for e in player.events()])
            player.loop = True
            player.rate = 4
            player.play()
            looped = []
            while not looped:
                player.update()
                looped = [e for e in player.events() if e.kind == "looped"]
            self.assertEqual((player.rate, player.loop), (4, True))
            self.assertEqual((looped[0].code, looped[0].offset, looped[0].message), (0, None, ""))

    def test_a_complete_frame_equals_the_render_of_the_scene(self):
        scene, renderer = stgs.Scene(path("tiny.stgs")), stgs.Renderer("cpu")
        player = stgs.Player(path("tiny.stgs"))
        player.wait_open()
        player.seek_frame(3)
        status = self.until(player, lambda s: s.is_complete)
        self.assertEqual((status.state, status.ready), ("paused", True))
        self.assertEqual(status.layers, status.layer_count)
        view = player.scene.start_view()
        frame = renderer.render(player.scene, status.seconds, view)
        np.testing.assert_array_equal(frame.rgba8, renderer.render(scene, status.seconds, view).rgba8)
        begin, end = player.buffered[0]
        self.assertTrue(begin <= status.seconds <= end)
        self.assertEqual(player.statistics.stored_primitives, scene.info.primitives)
        player_scene = player.scene  # the scene keeps its player alive
        del player
        gc.collect()
        self.assertEqual(len(player_scene.primitives(0.1)), len(scene.primitives(0.1)))

    def test_errors_are_raised_and_reported_as_events(self):
        player = stgs.Player(path("no such file"))
        with self.assertRaises(stgs.Error) as caught:
            player.wait_open()
        self.assertEqual(caught.exception.name, "STGS_ERROR_IO")
        self.assertIn("no such file", str(caught.exception))
        (event,) = player.events()
        self.assertEqual((event.kind, event.name), ("failed", "STGS_ERROR_IO"))
        self.assertEqual(player.update().state, "closed")
        for call in lambda: player.scene, lambda: player.seek(0):
            with self.assertRaises(stgs.Error) as caught:
                call()
            self.assertEqual(caught.exception.name, "STGS_ERROR_STATE")
        for settings in {"max_reads_in_flight": 0}, {"memory_budget": 1}, {"prefetch_seconds": math.nan}:
            with self.assertRaises(stgs.Error):
                stgs.Player(path("tiny.stgs"), **settings)
        with self.assertRaises(TypeError):
            stgs.Player(path("tiny.stgs"), no_such_setting=1)
        with self.assertRaises(stgs.Error):
            player.rate = 0
        self.assertEqual(player.rate, 1)

    def test_one_thread_updates_while_another_renders(self):
        player, renderer = stgs.Player(content("tiny.stgs")), stgs.Renderer("cpu")
        player.loop = True
        player.play()
        self.until(player, lambda s: s.ready)
        view = player.scene.start_view()
        frames, done = [], threading.Event()

        def render():
            while not done.is_set():
                frames.append(renderer.render(player.scene, 0.1, view).rgba8)

        rendering = threading.Thread(target=render)
        rendering.start()
        now = time.monotonic()
        while len(frames) < 20:
            player.update(now := now + 0.01)
        done.set()
        rendering.join()
        self.assertGreater(frames[-1].max(), 0)

    def test_players_can_be_destroyed_at_any_time(self):
        for i in range(50):
            player = stgs.Player(content("tiny.stgs"))
            player.play()
            if i % 2:
                player.update()


if __name__ == "__main__":
    try:
        subprocess.run([FIXTURE_PROGRAM, FOLDER], check=True)
        program = unittest.main(argv=["test_python.py", *sys.argv[3:]], exit=False)
    finally:
        shutil.rmtree(FOLDER)
    sys.exit(not program.result.wasSuccessful())
