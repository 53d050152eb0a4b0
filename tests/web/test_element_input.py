#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""<stgs-player>: keys, pointers, touch and the visibility of the controls."""
import time

from element_case import ElementCase, run


class InputTest(ElementCase):
    # Keys

    def test_keys_control_playback(self):
        self.show_ready(controls="")
        self.focus_view()
        self.browser.press(" ")
        self.wait("!player.paused")
        self.browser.press("k")
        self.wait("player.paused")
        self.browser.press("Home")
        self.wait("player.currentTime === 0 && !player.seeking")
        self.wait("player.buffered.end(0) >= 3")
        self.browser.press("ArrowRight")
        self.wait("Math.abs(player.currentTime - 1.2) < 0.01 && !player.seeking")
        self.browser.press("ArrowLeft")
        self.wait("player.currentTime < 0.01 && !player.seeking")
        self.browser.press(".")
        self.wait("Math.abs(player.currentTime - 1 / 30) < 1e-6")
        self.browser.press("ArrowUp")
        self.assertEqual(self.check("player.playbackRate"), 1.5)
        self.assertEqual(self.check("part('.speed').textContent"), "1.5×")
        self.browser.press("ArrowDown")
        self.browser.press("l")
        self.assertTrue(self.check("player.loop"))
        self.browser.press("i")
        self.assertFalse(self.check("part('.figures').hidden"))
        self.browser.press("End")
        self.wait("player.currentTime > 11.9 && !player.seeking")

    def test_keys_do_nothing_without_controls(self):
        self.show_ready()
        self.focus_view()
        self.browser.press(" ")
        self.browser.press("ArrowRight")
        self.assertEqual(self.check("[player.paused, player.currentTime]"), [True, 0])

    def test_space_presses_the_focused_button(self):
        self.show_ready(controls="")
        self.check("part('.loop').focus()")
        self.browser.press(" ")
        self.wait("player.loop")
        self.assertTrue(self.check("player.paused"))

    def test_the_tab_key_reaches_every_control(self):
        self.show_ready(controls="")
        names = []
        for _ in range(8):
            self.browser.press("Tab")
            names.append(self.check("player.shadowRoot.activeElement?.className.split(' ').pop()"))
            if len(names) == 3:
                self.capture("focus")
        self.assertEqual(names, ["view", "start", "seek", "play", "speed", "loop",
                                 "statistics", "fullscreen"])

    def test_the_speed_menu_by_keys(self):
        self.show_ready(controls="")
        self.check("part('.speed').focus()")
        self.browser.press("Enter")
        self.wait("!part('.menu').hidden")
        self.capture("menu")
        self.browser.press("ArrowDown")
        self.browser.press("Enter")
        self.wait("player.playbackRate === 1.5 && part('.menu').hidden")
        self.assertEqual(self.check("player.shadowRoot.activeElement === part('.speed')"), True)
        self.browser.press("Enter")
        self.browser.press("Escape")
        self.assertTrue(self.check("part('.menu').hidden"))

    # Pointers

    def test_the_slider_seeks(self):
        self.show_ready(controls="")
        self.wait("player.buffered.end(0) === 12")
        left, y = self.check("(() => { const r = part('.seek').getBoundingClientRect();"
                             "return [r.x, r.y + 10]; })()")
        width = self.check("part('.seek').clientWidth")
        self.browser.drag((left + 0.1 * width, y), (left + 0.5 * width, y), steps=10)
        self.wait("!player.seeking && Math.abs(player.currentTime - 6) < 0.05")
        self.assertEqual(self.check("part('.seek').getAttribute('aria-valuetext')"),
                         "6 seconds of 12 seconds")
        self.assertEqual(self.check("part('.seek').getAttribute('aria-valuemax')"), "12.00")
        self.assertIn("seeked", self.check("events"))

    def test_the_image_plays_by_click_and_orbits_by_drag(self):
        self.show_ready(controls="")
        self.browser.click(300, 300)
        self.wait("!player.paused")
        self.browser.click(300, 300)
        self.wait("player.paused")
        before = self.camera()["rotation"]
        self.browser.drag((300, 300), (500, 260))
        self.wait(f"parts.renderers[0].last.camera.rotation[0] !== {before[0]}")
        self.assertTrue(self.check("player.paused"))
        self.check("player.resetCamera()")
        self.wait(f"Math.abs(parts.renderers[0].last.camera.rotation[2] - {before[2]}) < 1e-9")

    def test_a_paused_player_renders_nothing(self):
        self.show_ready(controls="")
        self.wait("player.buffered.end(0) === 12")
        frames = self.check("new Promise((resolve) => { const [r] = parts.renderers;"
                            "const { frames } = r;"
                            "setTimeout(() => resolve(r.frames - frames), 500); })")
        self.assertEqual(frames, 0)

    def test_the_wheel_zooms_a_player_that_is_used(self):
        self.show_ready(controls="")
        distance = "parts.renderers[0].last.camera.translation[2]"
        start = self.check(distance)
        self.browser.move(300, 300)
        self.browser.move(310, 300)
        self.browser.wheel(-200)
        self.wait(f"{distance} < {start} - 0.5")

    def test_a_page_scrolls_over_a_player_that_is_not_used(self):
        self.check("document.body.style.height = '3000px'")
        self.show_ready(style="height: 400px; margin-top: 500px")
        distance = "parts.renderers[0].last.camera.translation[2]"
        start = self.check(distance)
        self.browser.move(300, 600)
        self.browser.wheel(100)
        self.wait("scrollY === 100")
        self.assertEqual(self.check(distance), start)

    def test_reduced_motion_ends_rotations_with_the_drag(self):
        self.browser.set_reduced_motion(True)
        self.addCleanup(self.browser.set_reduced_motion, False)
        self.show_ready(controls="")
        self.browser.drag((300, 300), (500, 300))
        rotation = "parts.renderers[0].last.camera.rotation[2]"
        self.wait(f"{rotation} !== 0")
        time.sleep(0.2)
        end = self.check(rotation)
        time.sleep(0.3)
        self.assertEqual(self.check(rotation), end)

    def test_fullscreen_by_key(self):
        self.show_ready(controls="")
        self.focus_view()
        self.browser.press("f")
        self.wait("document.fullscreenElement === player")
        self.wait("part('.fullscreen').getAttribute('aria-label') === 'Exit fullscreen'")
        self.browser.press("f")
        self.wait("document.fullscreenElement === null")

    def test_an_aborted_load_shows_nothing(self):
        self.show(controls="", src="")
        name = self.check("{ const c = new AbortController();"
                          "const done = player.load('slow.stgs', { signal: c.signal });"
                          "c.abort(); done.catch((error) => error.name); }")
        self.assertEqual(name, "AbortError")
        self.wait("part('.spinner').hidden && part('.start').hidden && part('.error').hidden")
        self.assertEqual(self.check("player.src"), "slow.stgs")

    def test_fly_keys_move_the_camera(self):
        self.show_ready(camera="fly", controls="")
        self.focus_view()
        start = self.camera()["translation"][2]
        self.browser.call("keyboard.down", "w")
        self.wait(f"parts.renderers[0].last.camera.translation[2] < {start} - 0.2")
        self.browser.call("keyboard.up", "w")

    def test_shift_and_arrows_rotate(self):
        self.show_ready(controls="")
        self.focus_view()
        self.browser.press("Shift+ArrowRight")
        self.wait("parts.renderers[0].last.camera.rotation[2] !== 0")
        self.assertEqual(self.check("player.currentTime"), 0)
        self.browser.press("r")
        self.wait("Math.abs(parts.renderers[0].last.camera.rotation[2]) < 1e-9")

    def test_two_fingers_pinch(self):
        self.browser.resize(360, 640, ratio=2, mobile=True)
        self.show_ready(controls="")
        distance = "parts.renderers[0].last.camera.translation[2]"
        start = self.check(distance)
        self.browser.touch("touchStart", (150, 300), (210, 300))
        for step in range(1, 6):
            self.browser.touch("touchMove", (150 - 10 * step, 300), (210 + 10 * step, 300))
        self.browser.touch("touchEnd")
        self.wait(f"{distance} < {start} - 1")

    def test_the_controls_hide_while_playing(self):
        self.show_ready(controls="")
        self.wait("player.buffered.end(0) === 12")
        self.capture("start")
        self.browser.click(300, 300)
        self.wait("part('.root').classList.contains('idle')")
        self.capture("idle")
        self.browser.move(400, 300)
        self.wait("!part('.root').classList.contains('idle')")
        self.browser.click(*self.centre(".statistics"))
        self.capture("playing")
        self.browser.click(300, 300)
        self.wait("player.paused")
        self.assertFalse(self.check("part('.root').classList.contains('idle')"))

    def test_playback_ends_and_is_repeated(self):
        self.show_ready(controls="")
        self.wait("player.buffered.end(0) === 12")
        self.check("player.currentTime = 11.8")
        self.check("player.play()")
        self.wait("player.ended")
        self.assertEqual(self.check("player.currentTime"), 12)
        self.assertEqual(self.check("part('.start').getAttribute('aria-label')"), "Replay")
        self.capture("ended")
        self.browser.click(*self.centre(".start"))
        self.wait("!player.ended && !player.paused && player.currentTime < 3")

    def test_the_player_on_a_phone(self):
        self.browser.resize(360, 640, ratio=2, mobile=True)
        self.show_ready(controls="")
        self.capture("phone")
        self.check("part('.statistics').click()")
        self.check("part('.speed').click()")
        self.capture("phone-menu")
        self.assertFalse(self.check("part('.menu').hidden"))


if __name__ == "__main__":
    run()
