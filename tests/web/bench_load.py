#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures how a page of stgs web loads in headless Chromium, and prints JSON: milliseconds from
navigation to each step (sdk/web/src/marks.ts), medians of the runs.

usage: bench_load.py STGS FILE [--mbit N --latency MS] [--runs N] [--cached] [--size WxH] [--until ready|drawn]
STGS: the program. FILE: an .stgs file
--mbit, --latency: a link between the browser and nginx, as of tests/bench/stream_over_http.py; a
           connection takes two latencies until its first byte. Default: none, files on loopback
--cached:  the files of the player, and Chromium's compiled code of them, are in its cache. Default:
           nothing is
--until:   the step that ends a run; default: drawn. A software renderer takes minutes for millions of
           primitives, and the steps before do not need it

`drawn` is the first image as the page has passed it to the GPU; Chromium rasterises it afterwards, here
on the CPU (SwiftShader). `image` is one more frame, drawn, rasterised and read back. `ready`: the base
layer of all that the first image needs is decoded.
"""
import argparse
import gzip
import json
import os
import re
import socket
import statistics
import subprocess
import sys
import tempfile
import threading

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "fetch"), os.path.join(HERE, "..", "bench")]
import stream_over_http  # noqa: E402
from browser import Browser  # noqa: E402
from nginx import Nginx  # noqa: E402

PLAYER = "document.querySelector('stgs-player')"
UNTIL = {"drawn": "performance.getEntriesByName('stgs: drawn').length > 0",
         "ready": f"{PLAYER} && {PLAYER}.readyState >= 2"}
STEPS = ("script", "worker", "compiled", "opened", "fetched", "decoded", "ready", "renderer", "uploaded", "drawn")
SECONDS = 120  # of a run, at most


def trace(browser, run):
    """Returns milliseconds from navigation to each mark of the page and its workers, which share a clock."""
    with tempfile.NamedTemporaryFile(prefix="stgs-trace-") as file:
        browser.call("browser.startTracing", None, {"path": file.name, "categories": ["blink.user_timing"]})
        run()
        browser.call("browser.stopTracing")
        events = json.load(file)["traceEvents"]
    marks = {}
    for event in sorted(events, key=lambda event: event["ts"]):
        url = event.get("args", {}).get("data", {}).get("documentLoaderURL", "")
        if event["name"].startswith("stgs: ") or (event["name"] == "navigationStart" and url.startswith("http")):
            marks.setdefault(event["name"], event["ts"])
    begin = marks.pop("navigationStart")
    return {name[len("stgs: "):]: (at - begin) / 1000 for name, at in marks.items()}


def make_site(stgs, scene, folder):
    """Writes the page and the compressed copies of its files. Returns the bytes of those."""
    subprocess.run([stgs, "web", scene, "-o", folder, "--log-level", "error"], check=True, stdout=subprocess.DEVNULL)
    sizes = {}
    for name in os.listdir(folder):
        if name.endswith((".html", ".js", ".wasm")):
            path = os.path.join(folder, name)
            with open(path, "rb") as file:
                content = gzip.compress(file.read(), 9, mtime=0)
            with open(path + ".gz", "wb") as file:
                file.write(content)
            os.utime(path + ".gz", (os.path.getmtime(path),) * 2)
            sizes[name] = len(content)
    return sizes


def load(browser, url, cached, until):
    """Loads the page. Returns the milliseconds of its steps."""
    browser.open("about:blank")
    if not cached:
        browser.send("Network.clearBrowserCache")

    def run():
        browser.call("page.goto", url, {"waitUntil": "commit"})
        browser.wait_for(f"({UNTIL[until]}) || !!({PLAYER} && {PLAYER}.error)", SECONDS)

    steps = trace(browser, run)
    if problem := browser.evaluate(f"{PLAYER}.error && {PLAYER}.error.message"):
        sys.exit(problem)
    if until != "drawn":
        return steps
    steps["image"] = browser.evaluate(f"""{PLAYER}.pause(), new Promise((resolve) => setTimeout(resolve, 500)).then(() => {{
        const begin = performance.now();
        return {PLAYER}.screenshot().then(() => performance.now() - begin); }})""")
    return steps


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("stgs")
    parser.add_argument("file")
    parser.add_argument("--mbit", type=float)
    parser.add_argument("--latency", type=float)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--cached", action="store_true")
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--until", choices=UNTIL, default="drawn")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="stgs-bench-") as folder:
        sizes = make_site(os.path.abspath(args.stgs), args.file, folder + "/site")
        with Nginx(folder, precompressed=True) as nginx, socket.create_server(("127.0.0.1", 0)) as listener:
            port = nginx.port
            if args.mbit:
                port = listener.getsockname()[1]
                bandwidth = stream_over_http.Bandwidth(args.mbit * 1e6 / 8)
                threading.Thread(target=stream_over_http.serve, daemon=True,
                                 args=(listener, nginx.port, args.latency * 1e-3, bandwidth)).start()
            browser = Browser()
            try:
                browser.resize(*map(int, re.findall(r"\d+", args.size)))
                url = f"http://127.0.0.1:{port}/site/index.html"
                runs = [load(browser, url, args.cached, args.until) for _ in range(args.runs + 1)][1:]  # the first warms up
            finally:
                browser.close()
    report = {f"{step}_ms": round(statistics.median(run[step] for run in runs), 1)
              for step in (*STEPS, "image") if all(step in run for run in runs)}
    print(json.dumps({"scene_bytes": os.path.getsize(args.file), "gzip_bytes": sizes, "cached": args.cached,
                      "mbit": args.mbit, "latency_ms": args.latency, "runs": args.runs, **report}, indent=2))


if __name__ == "__main__":
    main()
