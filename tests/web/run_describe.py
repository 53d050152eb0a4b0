#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs describe_vectors (tests/conformance), compiled to WebAssembly, in a worker of Chromium.

usage: run_describe.py PROGRAM.mjs [--floats] {[--max-memory N] FILE}...

Exit code 77: Chromium or playwright-core is missing
"""
import json
import os
import shutil
import sys
import tempfile

from browser import Browser, Server, require

HERE = os.path.dirname(os.path.abspath(__file__))
PAGE = "<!doctype html><title>describe_vectors</title>\n"
WORKER = """import create from "./program.mjs";
import { describe } from "./run_describe.mjs";
const load = async (name) => new Uint8Array(await (await fetch(name)).arrayBuffer());
const { args, files } = await (await fetch("job.json")).json();
const all = await load("files.bin");
const contents = files.map(([name, begin, end]) => [name, all.subarray(begin, end)]);
describe(create, await load("program.wasm"), args, contents)
  .then((output) => postMessage({ output }), (error) => postMessage({ error: String(error) }));
"""
RUN = """(() => {
  const worker = new Worker("worker.mjs", { type: "module" });
  worker.onmessage = ({ data }) => (window.result = data);
  worker.onerror = ({ message }) => (window.result = { error: message ?? "the worker did not start" });
})()"""
SECONDS = 500


def write_job(folder, program, arguments):
    """Writes the files of the page."""
    shutil.copy(program, os.path.join(folder, "program.mjs"))
    shutil.copy(program.removesuffix("mjs") + "wasm", os.path.join(folder, "program.wasm"))
    shutil.copy(os.path.join(HERE, "run_describe.mjs"), folder)
    files, at = [], 0
    with open(os.path.join(folder, "files.bin"), "wb") as out:
        for name in arguments:
            if not os.path.isfile(name):
                continue
            with open(name, "rb") as file:
                data = file.read()
            out.write(data)
            files.append((name, at, at + len(data)))
            at += len(data)
    for name, text in (("job.json", json.dumps({"args": arguments, "files": files})),
                       ("worker.mjs", WORKER), ("page.html", PAGE)):
        with open(os.path.join(folder, name), "w", encoding="utf-8") as file:
            file.write(text)


def main():
    require()
    program, *arguments = sys.argv[1:]
    with tempfile.TemporaryDirectory(prefix="stgs-vectors-") as folder:
        write_job(folder, program, arguments)
        server = Server(folder)
        browser = Browser()
        try:
            browser.open(server.url + "page.html")
            browser.evaluate(RUN)
            browser.wait_for("'result' in window", SECONDS)
            result = browser.evaluate("result")
        finally:
            browser.close()
            server.close()
    if "error" in result:
        sys.exit(result["error"])
    sys.stdout.write(result["output"])


if __name__ == "__main__":
    main()
