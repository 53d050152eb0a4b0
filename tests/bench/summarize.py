#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes SUMMARY.md: the latest and the best value of each headline metric, its target and peer.

usage: summarize.py [--check]     --check: exit code 1 if SUMMARY.md is not up to date
"""
import sys

import bench_data

SUMMARY = bench_data.FOLDER / "SUMMARY.md"
MAX_LINES = 80

# area: (label, machine, benchmark, case, metric)
HEADLINES = {
    "Quality (held-out cameras)": (
        ("basketball, best: PSNR", "h200", "train", "basketball_best_test", "psnr_db"),
        ("basketball, best: PSNR after colour map", "h200", "train", "basketball_best_test",
         "psnr_cc_db"),
        ("basketball, best: PSNR of moving pixels", "h200", "train", "basketball_best_test",
         "psnr_moving_db"),
        ("basketball, fast: PSNR", "h200", "train", "basketball_fast_test", "psnr_db"),
        ("workshop, best: PSNR", "h200", "train", "workshop_best_test", "psnr_db"),
        ("workshop, best: PSNR of moving pixels", "h200", "train", "workshop_best_test",
         "psnr_moving_db"),
        ("workshop, best: static drift", "h200", "train", "workshop_best_test",
         "static_drift_px_mean"),
        ("GPU against CPU renders, minimum", "h200", "parity", "conformance_gpu_vs_cpu",
         "psnr_db_min"),
        ("against the 3DGS rasteriser, minimum", "h200", "peer_3dgs", "taebak_2160p_static",
         "psnr_db_min"),
    ),
    "Size": (
        ("basketball, best, packed: file", "h100", "rate", "basketball_best_test", "file_bytes"),
        ("basketball, best, packed: PSNR", "h100", "rate", "basketball_best_test", "psnr_db"),
        ("basketball, best, packed: PSNR of moving pixels", "h100", "rate",
         "basketball_best_test", "psnr_moving_db"),
        ("taebak_lod2, quality 87.5: file", "xeon2", "convert", "taebak_q87.5", "file_bytes"),
        ("taebak_lod2, quality 87.5: PSNR to source", "xeon2", "convert", "taebak_q87.5",
         "psnr_to_source_db"),
        ("workshop, quality 87: per primitive", "xeon2", "pack", "workshop_fast_q87",
         "bytes_per_primitive"),
        ("workshop, quality 87: PSNR drop", "xeon2", "pack", "workshop_fast_q87", "psnr_drop_db"),
        ("basketball, quality 87: per primitive", "xeon2", "pack", "basketball_default_q87",
         "bytes_per_primitive"),
        ("basketball, quality 87: PSNR drop", "xeon2", "pack", "basketball_default_q87",
         "psnr_drop_db"),
        ("overhead of segments", "xeon2", "pack", "basketball_default_q87",
         "segment_overhead_percent"),
        ("demo: file", "xeon2", "demo", "demo", "file_bytes"),
        ("libstgs.so, stripped", "xeon2", "size", "libstgs_so_stripped", "file_bytes"),
    ),
    "Training": (
        ("basketball, fast", "h200", "train", "basketball_fast_test", "train_s"),
        ("basketball, best", "h200", "train", "basketball_best_test", "train_s"),
        ("step: 200,000 primitives, SH3, 640x360", "h200", "train_step",
         "cuda_640x360_n200k_sh3", "step_ms"),
        ("importances, workshop, best", "h200", "train", "workshop_best_test", "importance_s"),
        ("two GPUs against one, 1920x1440", "h200x2", "train_gpus", "workshop_1920x1440_2_gpu",
         "speedup_ratio"),
        ("demo: PSNR", "xeon2", "demo", "demo", "psnr_db"),
        ("demo: total time", "xeon2", "demo", "demo", "total_s"),
    ),
    "Rendering (1.7 million primitives, SH3)": (
        ("CUDA, 4K, dynamic", "h200", "render", "cuda_taebak_2160p_dynamic", "frame_ms_p50"),
        ("CUDA, 4K, static", "h200", "render", "cuda_taebak_2160p_static", "frame_ms_p50"),
        ("CUDA, 1080p, dynamic", "h200", "render", "cuda_taebak_1080p_dynamic", "frame_ms_p50"),
        ("Vulkan, 4K, dynamic", "h200", "render", "vulkan_taebak_2160p_dynamic", "frame_ms_p50"),
        ("Vulkan, 4K, static: speed against CUDA", "h200", "render",
         "vulkan_taebak_2160p_static", "speed_vs_cuda_ratio"),
        ("CUDA, two eyes over one, dynamic", "h200", "render",
         "cuda_taebak_2064x2208_dynamic_stereo", "ratio_to_one_eye"),
        ("the same, foveae of 300 pixels", "h200", "render",
         "cuda_taebak_2064x2208_dynamic_stereo_fovea300", "ratio_to_one_eye"),
        ("CUDA, ten times as many stored", "h200", "render",
         "cuda_taebak_2160p_static_stored_10x_sh0", "slowdown_percent"),
        ("CUDA, player at 100 fps: missed of 1000", "h200", "play",
         "cuda_taebak_2160p_dynamic_player_packed_camera0", "missed_frames"),
    ),
    "Streaming": (
        ("first read, 10 minutes", "xeon2", "timeline", "10min_2m", "first_read_bytes"),
        ("seek: bytes read over bytes active", "xeon2", "timeline", "10min_2m",
         "seek_read_ratio_max"),
        ("demo, 50 Mbit/s: base layer", "xeon2", "stream", "demo_50mbit_40ms", "base_ms"),
        ("demo, 50 Mbit/s: all layers", "xeon2", "stream", "demo_50mbit_40ms", "all_layers_ms"),
        ("a million, 50 Mbit/s: base layer", "xeon2", "stream", "60s_4m_50mbit_40ms", "base_ms"),
        ("a million, 50 Mbit/s: seek, p95", "xeon2", "stream", "60s_4m_50mbit_40ms",
         "seek_base_ms_p95"),
        ("a million, HTTP: rendered at 720p", "xeon2", "stream",
         "60s_4m_http_50mbit_40ms_render_720p", "base_rendered_ms"),
        ("a million, cold seek, CUDA, p95", "h200", "stream", "60s_4m_cold_cuda_1080p",
         "seek_rendered_ms_p95"),
        ("a million, cold seek, Vulkan, p95", "h200", "stream", "60s_4m_cold_vulkan_1080p",
         "seek_rendered_ms_p95"),
        ("live: append to visible, p95", "xeon2", "telepresence", "fragments_0.5s",
         "append_to_visible_s_p95"),
        ("live: join, p95", "xeon2", "telepresence", "fragments_0.5s", "join_s_p95"),
    ),
    "CPU": (
        ("decode, basketball, best, one core", "epyc2", "decode", "basketball_best_1_thread",
         "decode_mprims_per_cpu_s"),
        ("decode, taebak_lod2, CUDA, with uploads", "h100", "decode_cuda", "taebak_q87.5_1_copy",
         "decode_mprims_per_s"),
        ("decode, taebak_lod2, one core", "xeon2", "decode", "taebak_q88_1_thread",
         "decode_mprims_per_cpu_s"),
        ("encode, basketball, two cores", "xeon2", "encode_scene", "basketball_q85",
         "encode_mprims_per_s"),
        ("render 720p, 100,000 static", "epyc2", "render", "cpu_taebak_100k_720p_static", "fps"),
        ("render 720p, 500,000 static", "epyc2", "render", "cpu_taebak_500k_720p_static", "fps"),
        ("a million, seek with all layers, p95", "epyc2", "stream", "60s_4m_disk",
         "seek_all_layers_ms_p95"),
        ("memory of a player with 2 GiB", "xeon2", "sdk", "10min_12m_budget_2_gib",
         "process_growth_mib"),
        ("stgs_player_update, 3,264 segments", "xeon2", "sdk_call",
         "10min_12m_player_update_paused", "call_us"),
        ("start of the program", "epyc2", "cli", "version", "start_ms"),
        ("make demo from a fresh clone", "epyc2", "build", "make_demo", "total_s"),
        ("make check from a fresh clone", "epyc2", "build", "make_check", "total_s"),
    ),
}

HEAD = """# Benchmark summary

Written by `summarize.py` from `results.csv` and `targets.csv`; do not edit. Latest: the median of
the rows of the last commit (month-day); best: over all commits. A target that the latest value
misses is marked *. Names, machines and inputs: [README.md](README.md).

| | machine | latest | best | target | best peer |
|---|---|---|---|---|---|
"""


def format_value(value, unit):
    for size, prefix in ((1e6, "M"), (1e3, "k")):
        if unit == "B" and abs(value) >= size:
            return f"{value / size:.4g} {prefix}B"
    digits = f"{value:.4g}"
    return f"{digits} {unit}" if unit not in ("1", "count", "ratio") else digits


def best(values, higher):
    return max(values) if higher else min(values)


def target_text(targets, value, higher, unit):
    bounds = sorted((float(row.target) for row in targets if row.target), reverse=not higher)
    if not bounds:
        return ""
    missed = value < bounds[0] if higher else value > bounds[0]
    sign = ">=" if higher else "<="
    goal = f", goal {format_value(bounds[-1], unit)}" if len(bounds) > 1 else ""
    return f"{sign} {format_value(bounds[0], unit)}{'*' if missed else ''}{goal}"


def peer_text(targets, higher, unit):
    peers = [(float(row.peer_value), row.peer) for row in targets if row.peer]
    if not peers:
        return ""
    value, name = best(peers, higher)
    return f"{name} {format_value(value, unit)}"


def line_of(headline, rows, targets):
    label, machine, *names = headline
    found = bench_data.series(rows, machine, *names)
    if not found:
        raise ValueError(f"results.csv: no row of {'/'.join(names)} on {machine}")
    own_targets = [row for row in targets if row[:3] == tuple(names)]
    metric, unit = names[2], found[0].unit
    higher = (own_targets[0].direction == "higher" if own_targets
              else bench_data.higher_is_better(metric))
    last = bench_data.latest(found)
    value = bench_data.median(last)
    cells = (label, machine, f"{format_value(value, unit)} ({last[-1].date[5:]})",
             format_value(best([float(row.value) for row in found], higher), unit),
             target_text(own_targets, value, higher, unit), peer_text(own_targets, higher, unit))
    return f"| {' | '.join(cells)} |\n"


def summary(rows, targets):
    text = HEAD
    for area, headlines in HEADLINES.items():
        text += f"| **{area}** | | | | | |\n"
        text += "".join(line_of(headline, rows, targets) for headline in headlines)
    if text.count("\n") > MAX_LINES:
        raise ValueError(f"SUMMARY.md: {text.count(chr(10))} lines (expected at most {MAX_LINES})")
    return text


def main():
    text = summary(bench_data.read_results(), bench_data.read_targets())
    if sys.argv[1:] == ["--check"]:
        if SUMMARY.read_text(encoding="utf-8") != text:
            sys.exit("SUMMARY.md is not up to date; run tests/bench/summarize.py")
        return
    if sys.argv[1:]:
        sys.exit(__doc__)
    SUMMARY.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
