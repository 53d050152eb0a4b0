#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures the WebGPU renderer with a random moving scene, and prints, for each sort that the adapter can
run, a row of a table and then a line of JSON: milliseconds on the GPU of evaluation, culling, projection
and SH (project), of the sort, of both (compute), of rasterisation, and the fragments per pixel.

usage: bench_webgpu.py SOURCES [--primitives N] [--degree D] [--size S] [--image WxH] [--frames N]
                       [--dawn DAWN | --bundle OUT]
SOURCES: the TypeScript, with the generated shaders. Default: Chromium with its software renderer
--size: standard deviation of the primitives, scene units; their ball has a radius of 2
--dawn: run in node with dawn.node of npm's package webgpu
--bundle: write OUT, to be run elsewhere as `node OUT DAWN JSON`, and print that JSON
"""
import argparse
import json
import os
import subprocess
import tempfile

from page_server import PageServer, WEBGPU_FLAGS

HERE = os.path.dirname(os.path.abspath(__file__))
PAGE = '<!doctype html><script type="module" src="bench.mjs"></script>\n'


def bundle(sources, out):
    subprocess.run(["esbuild", os.path.join(HERE, "webgpu_bench.mjs"), "--bundle", "--format=esm",
                    "--target=es2022", "--log-level=warning", "--external:node:*",
                    f"--alias:renderer={os.path.join(os.path.abspath(sources), 'webgpu')}",
                    f"--outfile={out}"], check=True)


def run_in_chromium(folder, job):
    with open(os.path.join(folder, "job.json"), "w", encoding="ascii") as file:
        json.dump(job, file)
    with open(os.path.join(folder, "bench.html"), "w", encoding="ascii") as file:
        file.write(PAGE)
    server = PageServer(folder)
    # Timestamps are not rounded.
    flags = [*WEBGPU_FLAGS, "--enable-webgpu-developer-features"]
    posts = server.run("bench.html", 500, flags)
    server.close()
    if posts["done"] != b"ok":
        raise SystemExit(posts["done"].decode())
    return posts["result"].decode()


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("sources")
    parser.add_argument("--primitives", type=int, default=40000)
    parser.add_argument("--degree", type=int, default=3)
    parser.add_argument("--size", type=float, default=0.01)
    parser.add_argument("--image", default="320x180")
    parser.add_argument("--frames", type=int, default=10)
    parser.add_argument("--dawn")
    parser.add_argument("--bundle")
    args = parser.parse_args()
    width, height = map(int, args.image.split("x"))
    job = {"primitives": args.primitives, "degree": args.degree, "size": args.size, "width": width,
           "height": height, "frames": args.frames}
    if args.bundle:
        bundle(args.sources, args.bundle)
        print(json.dumps(job))
        return
    with tempfile.TemporaryDirectory(prefix="stgs-bench-") as folder:
        bundle(args.sources, os.path.join(folder, "bench.mjs"))
        if args.dawn:
            command = ["node", os.path.join(folder, "bench.mjs"), os.path.abspath(args.dawn)]
            subprocess.run([*command, json.dumps(job)], check=True)
        else:
            print(run_in_chromium(folder, job))


if __name__ == "__main__":
    main()
