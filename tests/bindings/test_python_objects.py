#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Objects of the Python module: context managers, repr(), type errors, views, waiting.

usage: test_python_objects.py FIXTURE_PROGRAM [unittest arguments], with the module on PYTHONPATH
"""
import gc
import math
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import unittest

import numpy as np

import stgs

FIXTURE_PROGRAM = sys.argv[1]
FOLDER = tempfile.mkdtemp()


def path(name):
    return os.path.join(FOLDER, name)


def content(name):
    with open(path(name), "rb") as file:
        return file.read()


class Closing(unittest.TestCase):
    def fails(self, message, call):
        with self.assertRaises(stgs.Error) as caught:
            call()
        self.assertEqual(caught.exception.name, "STGS_ERROR_STATE")
        self.assertEqual(str(caught.exception), message)

    def test_a_with_block_closes_its_scene(self):
        borrowed = bytearray(content("tiny.stgs"))
        with stgs.Scene(borrowed) as scene:
            self.assertFalse(scene.closed)
            self.assertGreater(scene.info.primitives, 0)
        self.assertTrue(scene.closed)
        borrowed.clear()  # not borrowed any more
        renderer = stgs.Renderer("cpu")
        for call in (lambda: scene.info, lambda: scene.title, lambda: scene.primitives(0),
                     lambda: renderer.render(scene, 0, stgs.View())):
            self.fails("the scene is closed", call)
        scene.close()  # closing again has no effect

    def test_a_with_block_propagates_errors(self):
        with self.assertRaises(ZeroDivisionError):
            with stgs.Scene(path("tiny.stgs")) as scene, stgs.Renderer("cpu") as renderer:
                1 / 0
        self.assertTrue(scene.closed and renderer.closed)
        self.fails("the renderer is closed", lambda: renderer.backend)

    def test_closing_a_player_closes_its_scene(self):
        with stgs.Player(path("tiny.stgs")) as player:
            player.wait_open()
            scene = player.scene
            scene.close()  # no effect: the player owns it
            self.assertGreater(scene.info.primitives, 0)
            with player.scene:
                pass
            self.assertFalse(scene.closed)
        self.assertTrue(player.closed and scene.closed)
        for call in lambda: player.update(), lambda: player.scene, lambda: scene.info:
            self.fails("the player is closed", call)
        del player
        gc.collect()
        self.assertTrue(scene.closed)

    def test_closing_waits_for_calls_in_other_threads(self):
        for _ in range(10):
            scene, renderer = stgs.Scene(path("tiny.stgs")), stgs.Renderer("cpu")
            view = scene.start_view()
            started, results = threading.Event(), []

            def render():
                try:
                    while True:
                        results.append(renderer.render(scene, 0.1, view))
                        started.set()
                except stgs.Error as error:
                    results.append(error)

            thread = threading.Thread(target=render)
            thread.start()
            started.wait()
            scene.close()
            thread.join()
            self.assertEqual(str(results[-1]), "the scene is closed")


class Representations(unittest.TestCase):
    def test_repr_describes_objects(self):
        file = content("tiny.stgs")
        scene, renderer = stgs.Scene(path("tiny.stgs")), stgs.Renderer("cpu")
        info = scene.info
        length = f"{info.duration_seconds:.3f} s, 6 frames"
        self.assertEqual(repr(scene), f"<stgs.Scene '{path('tiny.stgs')}', {length}, 400 primitives>")
        self.assertEqual(repr(stgs.Scene(file)),
                         f"<stgs.Scene of {len(file)} bytes, {length}, 400 primitives>")
        self.assertRegex(repr(info), r"^<stgs\.SceneInfo 0\.\d{3} s, 6 frames at [\d.]+ fps, 400 primitives>$")
        self.assertEqual(repr(renderer), "<stgs.Renderer 'cpu'>")
        view = scene.start_view()
        self.assertRegex(repr(view), r"^<stgs\.View 64x48, fx [\d.]+, fy [\d.]+, at \(.*\)>$")
        image = renderer.render(scene, 0.1, view, ["rgba8", "depth"])
        self.assertEqual(repr(image), "<stgs.Image rgba8 (48, 64, 4), depth (48, 64)>")
        self.assertEqual(repr(stgs.Image()), "<stgs.Image>")
        primitives = scene.primitives(0.1)
        self.assertEqual(repr(primitives), f"<stgs.Primitives, {len(primitives)} primitives>")
        scene.close()
        renderer.close()
        self.assertEqual(repr(scene), f"<stgs.Scene '{path('tiny.stgs')}', closed>")
        self.assertEqual(repr(renderer), "<stgs.Renderer, closed>")

    def test_repr_describes_the_state_of_players(self):
        player = stgs.Player(path("tiny.stgs"))
        self.assertEqual(repr(player), f"<stgs.Player '{path('tiny.stgs')}', opening at 0.000 s>")
        player.wait_open()
        status = player.seek_and_wait(0.1)
        self.assertEqual(repr(player), f"<stgs.Player '{path('tiny.stgs')}', paused at 0.100 s>")
        self.assertRegex(repr(status),
                         r"^<stgs\.PlayerStatus paused at 0\.100 s, (\d+) of \1 layers, complete>$")
        self.assertRegex(repr(player.scene), r"^<stgs\.Scene of a player, ")
        self.assertEqual(repr(player.events()[0]), "<stgs.PlayerEvent opened at 0.000 s>")
        self.assertEqual(repr(player.live), "<stgs.PlayerLive, not growing>")
        self.assertRegex(repr(player.statistics), r"^<stgs\.PlayerStatistics .* bytes in memory>$")
        player.close()
        self.assertEqual(repr(player), f"<stgs.Player '{path('tiny.stgs')}', closed>")


class Arguments(unittest.TestCase):
    def setUp(self):
        self.scene, self.renderer = stgs.Scene(path("tiny.stgs")), stgs.Renderer("cpu")
        self.view = self.scene.start_view()

    def assert_type_error(self, message, call):
        with self.assertRaises(TypeError) as caught:
            call()
        self.assertIn(message, str(caught.exception))

    def test_type_errors_name_the_wrong_type(self):
        expected = "views must be a stgs.View or a sequence of them, not "
        render = lambda views: self.renderer.render(self.scene, 0.1, views)
        self.assert_type_error(expected + "a tuple that contains int", lambda: render((1, 2, 3)))
        self.assert_type_error(expected + "a list that contains NoneType", lambda: render([self.view, None]))
        self.assert_type_error(expected + "int", lambda: render(5))
        self.assert_type_error(expected + "a str that contains str", lambda: render("front"))
        self.assert_type_error("out must be a stgs.Image or a sequence of them, not a list that contains ndarray",
                               lambda: self.renderer.render(self.scene, 0.1, [self.view],
                                                            out=[np.zeros((48, 64, 4), np.uint8)]))
        self.assert_type_error("view: stgs.View", lambda: self.scene.framed((1, 2)))
        self.assert_type_error("unknown setting 'no_such_setting'",
                               lambda: stgs.Player(path("tiny.stgs"), no_such_setting=1))

    def test_a_tuple_of_views_is_accepted(self):
        images = self.renderer.render(self.scene, 0.1, (self.view, self.view))
        self.assertEqual(len(images), 2)
        np.testing.assert_array_equal(images[0].rgba8, images[1].rgba8)

    def test_times_outside_the_clip_are_errors(self):
        for call in (lambda: self.renderer.render(self.scene, 99, self.view),
                     lambda: self.scene.primitives(-1)):
            with self.assertRaises(stgs.Error) as caught:
                call()
            self.assertEqual(caught.exception.name, "STGS_ERROR_ARGUMENT")
            self.assertIn("outside of the clip", str(caught.exception))


class Views(unittest.TestCase):
    def test_resizing_keeps_pixels_square(self):
        view = stgs.View()  # 1280x720
        square = view.resized(720, 720)
        self.assertEqual(square.fx, square.fy)
        self.assertEqual((square.cx, square.cy), (360, 360))
        self.assertAlmostEqual(square.fx, 360)
        stretched = view.stretched(720, 720)
        self.assertAlmostEqual(stretched.fx / stretched.fy, 720 / 1280)
        for size in (0, 10), (10, 1 << 20):
            for call in view.resized, view.stretched:
                with self.assertRaises(stgs.Error):
                    call(*size)

    def test_views_orbit_their_target(self):
        eye, target, up = np.array([0.0, -1, -4]), np.array([0.5, 0, 1]), (0, -1, 0)
        view = stgs.View().looking_at(eye, target, up)
        position = lambda v: -v.rotation.T @ v.translation
        np.testing.assert_allclose(position(view), eye, atol=1e-5)
        turned = view
        for _ in range(8):
            turned = turned.orbited(target, math.tau / 8, up=up)
            self.assertAlmostEqual(np.linalg.norm(position(turned) - target),
                                   np.linalg.norm(eye - target), places=4)
        np.testing.assert_allclose(position(turned), eye, atol=1e-4)
        self.assertLess(position(view.orbited(target, 0, 0.2, up))[1], -1)
        for wrong in (lambda: view.looking_at(eye, eye), lambda: view.orbited(eye, 1),
                      lambda: view.looking_at(eye, target, target - eye)):
            with self.assertRaises(stgs.Error) as caught:
                wrong()
            self.assertEqual(caught.exception.name, "STGS_ERROR_ARGUMENT")
        with self.assertRaises(TypeError):
            view.looking_at((1, 2), target)


class Waiting(unittest.TestCase):
    def test_seek_and_wait_loads_a_complete_time(self):
        player = stgs.Player(path("tiny.stgs"))
        with self.assertRaises(stgs.Error):
            player.seek_and_wait(0.1, timeout=-1)
        player.wait_open()
        status = player.seek_and_wait(0.1, timeout=60)
        self.assertTrue(status.is_complete)
        self.assertEqual(status.layers, status.layer_count)
        scene, renderer = stgs.Scene(path("tiny.stgs")), stgs.Renderer("cpu")
        view = scene.start_view()
        np.testing.assert_array_equal(renderer.render(player.scene, 0.1, view).rgba8,
                                      renderer.render(scene, 0.1, view).rgba8)


if __name__ == "__main__":
    try:
        subprocess.run([FIXTURE_PROGRAM, FOLDER], check=True)
        program = unittest.main(argv=["test_python_objects.py", *sys.argv[2:]], exit=False)
    finally:
        shutil.rmtree(FOLDER)
    sys.exit(not program.result.wasSuccessful())
