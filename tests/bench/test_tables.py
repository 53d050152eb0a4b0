# SPDX-License-Identifier: Apache-2.0
"""Tests that the tables are well-formed and that SUMMARY.md is generated from them."""
import unittest

import bench_data
import summarize
from bench_data import Result, Target

MACHINES = {"cpu": {}}
ROW = Result("2026-01-02", "0123abc", "cpu", "render", "cpu_scene_720p", "frame_ms_p50", "1.5",
             "ms", "stgs bench scene.stgs  # run 1")


class Tables(unittest.TestCase):
    def test_results_are_well_formed(self):
        rows = bench_data.read_results()
        self.assertGreater(len(rows), 1000)
        self.assertEqual(list(bench_data.result_problems(rows, bench_data.read_machines())), [])

    def test_targets_are_well_formed(self):
        self.assertEqual(list(bench_data.target_problems(bench_data.read_targets())), [])

    def test_each_target_has_a_result(self):
        measured = {(row.benchmark, row.case, row.metric) for row in bench_data.read_results()}
        self.assertEqual([row for row in bench_data.read_targets()
                          if row.target and row[:3] not in measured], [])

    def test_the_summary_is_up_to_date_and_short(self):
        text = summarize.SUMMARY.read_text(encoding="utf-8")
        self.assertLessEqual(len(text.splitlines()), summarize.MAX_LINES)
        self.assertEqual(text, summarize.summary(bench_data.read_results(),
                                                 bench_data.read_targets()),
                         "run tests/bench/summarize.py")


class Checks(unittest.TestCase):
    """Rows that break a rule are reported."""

    def problems(self, **changes):
        return list(bench_data.result_problems([ROW._replace(**changes)], MACHINES))

    def test_rows_that_break_a_rule(self):
        self.assertEqual(self.problems(), [])
        self.assertEqual(self.problems(commit=""), [])
        for column, value in (("date", "2.1.2026"), ("commit", "HEAD"), ("machine", "gpu"),
                              ("case", "CPU scene"), ("metric", "Frame ms"), ("value", "nan"),
                              ("value", "1,5"), ("unit", "s"), ("unit", "lightyears"),
                              ("command", "  # run 1")):
            with self.subTest(column=column, value=value):
                self.assertTrue(self.problems(**{column: value}))

    def test_repeated_rows_and_rows_out_of_order(self):
        self.assertIn("repeats", "".join(bench_data.result_problems([ROW, ROW], MACHINES)))
        second = ROW._replace(command="stgs bench scene.stgs  # run 2")
        self.assertEqual(list(bench_data.result_problems([ROW, second], MACHINES)), [])
        earlier = second._replace(date="2026-01-01")
        self.assertIn("order", "".join(bench_data.result_problems([ROW, earlier], MACHINES)))

    def test_targets_that_break_a_rule(self):
        target = Target("render", "cpu_scene_720p", "frame_ms_p50", "2", "lower", "", "", "a goal")
        self.assertEqual(list(bench_data.target_problems([target])), [])
        for changes in ({"direction": "down"}, {"target": "fast"}, {"source": ""},
                        {"peer": "gsplat", "peer_value": "3"}, {"peer": "gsplat", "target": ""}):
            with self.subTest(**changes):
                self.assertTrue(list(bench_data.target_problems([target._replace(**changes)])))
        self.assertTrue(list(bench_data.target_problems([target, target])))

    def test_units_and_directions_follow_from_names(self):
        for metric, unit, higher in (
                ("frame_ms_p50", "ms", False), ("decode_mprims_per_cpu_s", "Mprimitive/s", True),
                ("psnr_db", "dB", True), ("psnr_drop_db", "dB", False), ("train_s", "s", False),
                ("bytes_per_primitive", "B", False), ("ratio_to_one_eye", "ratio", False),
                ("fps", "fps", True), ("missed_frames", "count", False)):
            with self.subTest(metric=metric):
                self.assertEqual(bench_data.unit_of(metric), unit)
                self.assertEqual(bench_data.higher_is_better(metric), higher)

    def test_the_summary_has_latest_best_target_and_peer(self):
        rows = [ROW, ROW._replace(date="2026-01-03", commit="0123abd", value="3"),
                ROW._replace(date="2026-01-03", commit="0123abd", value="2", command="c  # run 2"),
                ROW._replace(date="2026-01-04", commit="", value="1")]
        names = ("render", "cpu_scene_720p", "frame_ms_p50")
        targets = [Target(*names, "2", "lower", "", "", "a"),
                   Target(*names, "1", "lower", "", "", "b"),
                   Target(*names, "", "lower", "gsplat", "4", "c"),
                   Target(*names, "", "lower", "higs", "3.5", "d")]
        self.assertEqual(summarize.line_of(("scene", "cpu", *names), rows, targets),
                         "| scene | cpu | 2.5 ms (01-03) | 1.5 ms | <= 2 ms*, goal 1 ms | "
                         "higs 3.5 ms |\n")


if __name__ == "__main__":
    unittest.main()
