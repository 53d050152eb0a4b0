# SPDX-License-Identifier: Apache-2.0
"""Tests run_bench.py with a fake stgs, and cases.json against the options of the program.

usage: test_run_bench.py STGS
"""
import csv
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import bench_data
import run_bench

SCHEMAS = run_bench.SOURCE / "tools/schema"
STGS = sys.argv.pop() if len(sys.argv) > 1 and not sys.argv[-1].startswith("-") else None
FAKE = """#!{python}
import json, sys
count = open("{folder}/count", "a+")
count.seek(0)
n = len(count.read())
count.write("x")
for o in [a for i, a in enumerate(sys.argv) if sys.argv[i - 1] == "-o"]:
    open(o, "w").close()
times = {{key: {{"mean": 1, "p50": {times}[n % 5], "p95": 3, "p99": 4}} for key in
         ("frame_ms", "fetch_ms", "slice_ms", "bin_ms", "blend_ms", "device_ms")}}
json.dump({{"stored": 100, "num_frames": 20, "cold": times, "warm": {{"fps": 50, **times}}}},
          sys.stdout)
"""


def expanded():
    book = json.loads(run_bench.CASES.read_text(encoding="utf-8"))
    return [case for entry in book["cases"] for case in run_bench.expand(entry)]


def metric_paths(case):
    for spec in case["metrics"].values():
        if isinstance(spec, str):
            yield spec.rstrip("?")
        else:
            yield from (spec["value"], *spec.get("over", []))
            if "minus" in spec:
                yield spec["minus"]
    if "table" in case:
        yield from (f"{case['table']['rows']}.{column}"
                    for column in (case["table"]["name"], *case["table"]["metrics"].values()))


def in_schema(schema, node, path):
    for key in path.split("."):
        if "$ref" in node:
            node = schema["$defs"][node["$ref"].rsplit("/", maxsplit=1)[1]]
        node = node.get("items", node)
        node = node.get("properties", {}).get(key)
        if node is None:
            return False
    return True


class Cases(unittest.TestCase):
    def test_names_are_unique_and_well_formed(self):
        cases = expanded()
        self.assertEqual(len({case["name"] for case in cases}), len(cases))
        for case in cases:
            with self.subTest(case=case["name"]):
                self.assertRegex(case["case"], bench_data.NAME)
                for metric in case["metrics"]:
                    self.assertRegex(metric, bench_data.NAME)

    def test_metrics_are_in_the_schema_of_the_command(self):
        for case in expanded():
            program, verb = case["command"].split()[:2]
            if program != "{stgs}":
                continue
            schema = json.loads((SCHEMAS / f"{verb}.json").read_text(encoding="utf-8"))
            for path in metric_paths(case):
                with self.subTest(case=case["name"], path=path):
                    self.assertTrue(in_schema(schema, schema, path))

    @unittest.skipUnless(STGS, "needs the program")
    def test_the_program_has_the_options(self):
        book = json.loads(run_bench.CASES.read_text(encoding="utf-8"))
        helps = {}
        for command in [*(case["command"] for case in expanded()),
                        *(recipe for recipe in book["files"].values() if recipe)]:
            program, verb, *words = command.split()
            if program != "{stgs}":
                continue
            if verb not in helps:
                helps[verb] = subprocess.run([STGS, verb, "--help"], capture_output=True, text=True,
                                             check=True).stdout
            for option in [word for word in words if word.startswith("-")]:
                with self.subTest(verb=verb, option=option):
                    self.assertRegex(helps[verb], rf"(?<![\w-]){re.escape(option)}(?![\w-])")


class Runs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.results = self.folder / "results.csv"
        self.write([])

    def write(self, rows):
        with open(self.results, "w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([bench_data.RESULT_COLUMNS, *rows])

    def bench(self, *options, times=(10, 11, 9, 10, 10)):
        fake = self.folder / "stgs"
        fake.write_text(FAKE.format(python=sys.executable, folder=self.folder, times=times),
                        encoding="utf-8")
        fake.chmod(0o755)
        (self.folder / "packed.stgs").touch()
        return subprocess.run(
            [sys.executable, run_bench.__file__, "--stgs", fake, "--work", self.folder, "--results",
             self.results, *options], capture_output=True, text=True, check=False, timeout=60)

    def row(self, value, run=1):
        return ("2026-01-01", "0123abc", "xeon2", "render", "cpu_sample_half_fast_i300_640x360",
                "frame_ms_p50", value, "ms", f"stgs bench  # run {run}")

    def verdicts(self, *options, **settings):
        done = self.bench("render_cpu_sample_640x360", "--machine", "xeon2", *options, **settings)
        self.assertEqual(done.returncode, 0, done.stderr)
        return {line.split(" | ")[1]: line.split(" | ")[4] for line in done.stdout.splitlines()}

    def test_metrics_move_only_beyond_their_noise(self):
        self.assertEqual(self.verdicts()["frame_ms_p50"], "new")
        self.write([self.row(10.15)])
        self.assertEqual(self.verdicts(times=(10,) * 5)["frame_ms_p50"], "same")  # less than 2 %
        self.write([self.row(13)])
        self.assertEqual(self.verdicts(times=(10, 11, 9, 11, 9))["frame_ms_p50"], "same")  # MAD 1
        self.assertEqual(self.verdicts(times=(10,) * 5)["frame_ms_p50"], "better")
        self.assertEqual(self.verdicts(times=(14,) * 5)["frame_ms_p50"], "worse")
        self.write([self.row(value, run) for run, value in enumerate((12, 13, 14), 1)])
        self.assertEqual(self.verdicts(times=(10,) * 5)["frame_ms_p50"], "same")  # earlier noise

    def test_rows_are_appended_and_read_again(self):
        for _ in range(2):
            self.verdicts("--append", "--repetitions", "2")
        rows = bench_data.read_results(self.results)
        machines = bench_data.read_machines()
        self.assertEqual(list(bench_data.result_problems(rows, machines)), [])
        runs = [row.command.rsplit("  # ")[1] for row in rows if row.metric == "fps"]
        self.assertEqual(runs, ["run 1", "run 2", "run 3", "run 4"])
        self.assertTrue(rows[0].command.startswith("stgs bench packed.stgs --backend cpu"))
        self.assertNotIn(str(self.folder), self.results.read_text(encoding="utf-8"))

    def test_errors_name_the_problem(self):
        self.assertIn("no case 'walk'", self.bench("walk").stderr)
        self.assertIn("add it to machines.csv", self.bench("--machine", "mine").stderr)
        self.assertIn("--append needs --machine", self.bench("--append").stderr)
        self.assertIn("no such file", self.bench("--file", "a.stgs=b").stderr)
        done = self.bench("render_cuda_1080p_static")
        self.assertEqual((done.returncode, done.stdout), (1, ""))
        self.assertIn("--file taebak.stgs=PATH", done.stderr)


if __name__ == "__main__":
    unittest.main()
