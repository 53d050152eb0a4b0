#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures the time of a frame of a static scene in headless Chromium, with this project's renderer and
with that of PlayCanvas, and prints JSON: milliseconds, medians of the frames, drawn to the last pixel;
their ratio; and the PSNR between the two images.

usage: bench_frames.py STGS MAKE_WEB_SCENE PACKAGE NPM [--primitives N] [--degree D] [--image WxH]
                       [--frames N] [--renderer webgl2|webgpu]
PACKAGE: the folder of stgs.js. NPM: a node_modules folder with tests/web/package.json
"""
import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "fetch")]
from browser import Browser  # noqa: E402
from nginx import Nginx  # noqa: E402
from page_server import WEBGPU_FLAGS  # noqa: E402

PAGE = """<!doctype html>
<script type="importmap">{"imports": {"playcanvas": "./playcanvas.js"}}</script>
<script type="module" src="frames_bench.js"></script>
"""
FOCAL = 7 / 6  # of the width of the image
SECONDS = 500


def prepare(args, folder):
    """Writes the page and the scene, in both formats."""
    for name in os.listdir(args.package):
        if name.endswith((".js", ".wasm")):
            shutil.copy(os.path.join(args.package, name), folder)
    for name in ("frames_bench.js", "decode_scene.js"):
        shutil.copy(os.path.join(HERE, name), folder)
    shutil.copy(os.path.join(args.npm, "playcanvas/build/playcanvas.mjs"), os.path.join(folder, "playcanvas.js"))
    with open(os.path.join(folder, "bench.html"), "w", encoding="ascii") as file:
        file.write(PAGE)
    moving, model, static = (os.path.join(folder, name) for name in ("moving.stgs", "scene.ply", "static.stgs"))
    subprocess.run([args.make, moving, str(args.primitives), str(args.degree)], check=True)
    for command in ((moving, model, "--time", "1"), (model, static)):
        subprocess.run([args.stgs, "convert", *command, "--log-level", "error"], check=True,
                       stdout=subprocess.DEVNULL)


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    for name in ("stgs", "make", "package", "npm"):
        parser.add_argument(name)
    parser.add_argument("--primitives", type=int, default=20000)
    parser.add_argument("--degree", type=int, default=3)
    parser.add_argument("--image", default="320x180")
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--renderer", choices=["webgl2", "webgpu"], default="webgl2")
    args = parser.parse_args()
    width, height = map(int, args.image.split("x"))
    job = {"renderer": args.renderer, "width": width, "height": height, "focal": FOCAL * width, "frames": args.frames}
    with tempfile.TemporaryDirectory(prefix="stgs-bench-") as folder:
        prepare(args, folder)
        with Nginx(folder) as nginx:
            browser = Browser(WEBGPU_FLAGS if args.renderer == "webgpu" else ())
            try:
                browser.open(f"http://127.0.0.1:{nginx.port}/bench.html")
                browser.wait_for("'ready' in window")
                # Longer than a command of the browser may take.
                browser.evaluate(f"""measure({json.dumps(job)}).then((result) => (window.result = result),
                    (error) => (window.result = `${{error}} ${{error.stack}}`)), 0""")
                browser.wait_for("'result' in window", SECONDS)
                result = browser.evaluate("result")
            finally:
                browser.close()
    if isinstance(result, str):
        sys.exit(result)
    print(json.dumps({"primitives": args.primitives, "degree": args.degree, **job,
                      **{key: value and round(value, 2) for key, value in result.items()}}, indent=2))


if __name__ == "__main__":
    main()
