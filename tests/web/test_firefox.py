#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The package plays a scene in Firefox, on a virtual display.

usage: test_firefox.py MAKE_WEB_SCENE PACKAGE
PACKAGE: the folder of stgs.js. With SCREENSHOTS=FOLDER in the environment, it writes an image. Exit
code 77: Firefox, Xvfb or nginx is missing, or this Firefox has no WebGL2
"""
import os
import shutil
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "fetch"), os.path.join(HERE, "..", "play")]
from display import Display  # noqa: E402
from firefox import FIREFOX, Firefox  # noqa: E402
from nginx import Nginx  # noqa: E402

FILES = ("stgs.js", "stgs-worker.js", "stgs-webgl2.js", "stgs-webgpu.js", "stgs-sorter.js", "stgs-core.wasm")
COLOURS = """player.screenshot().then((blob) => createImageBitmap(blob)).then((image) => {
  const canvas = new OffscreenCanvas(image.width, image.height), context = canvas.getContext("2d");
  context.drawImage(image, 0, 0);
  return new Set(context.getImageData(0, 0, image.width, image.height).data).size;
})"""


def play(browser):
    browser.wait_for("'show' in window")
    browser.evaluate("show({src: 'scene.stgs', controls: ''})")
    browser.wait_for("player.readyState >= 3 || player.error", 60)
    problem = browser.evaluate("player.error && player.error.message")
    assert problem is None, problem
    browser.evaluate("player.play()")
    browser.wait_for("player.currentTime > 0.5", 60)
    browser.evaluate("player.pause(), player.currentTime = 1.5, 0")
    browser.wait_for("!player.seeking", 60)
    assert browser.evaluate("player.currentTime") == 1.5
    colours = browser.evaluate(COLOURS)
    assert colours > 50, f"the image has {colours} values"
    if folder := os.environ.get("SCREENSHOTS"):
        browser.screenshot(os.path.join(folder, "firefox.png"))


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    make, package = map(os.path.abspath, sys.argv[1:])
    if None in (FIREFOX, shutil.which("nginx"), shutil.which("Xvfb")):
        print("skipped: needs firefox-esr, nginx and xvfb")
        return 77
    with tempfile.TemporaryDirectory(prefix="stgs-firefox-page-") as work:
        for path in [os.path.join(package, name) for name in FILES] + [
                os.path.join(HERE, name) for name in ("player_page.html", "decode_scene.js")]:
            shutil.copy(path, work)
        subprocess.run([make, os.path.join(work, "scene.stgs"), "3000", "3"], check=True)
        with Nginx(work) as nginx, Display() as display:
            browser = Firefox(display.environment)
            try:
                browser.open(f"http://127.0.0.1:{nginx.port}/player_page.html")
                print(browser.evaluate("navigator.userAgent"))
                if not browser.evaluate("!!document.createElement('canvas').getContext('webgl2')"):
                    print("skipped: this Firefox has no WebGL2")
                    return 77
                play(browser)
            finally:
                browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
