# SPDX-License-Identifier: Apache-2.0
"""Reads and checks the tables of this folder: results.csv, targets.csv and machines.csv."""
import collections
import csv
import pathlib
import re
import statistics

FOLDER = pathlib.Path(__file__).resolve().parent
RESULTS = FOLDER / "results.csv"
TARGETS = FOLDER / "targets.csv"
MACHINES = FOLDER / "machines.csv"

RESULT_COLUMNS = ("date", "commit", "machine", "benchmark", "case", "metric", "value", "unit",
                  "command")
TARGET_COLUMNS = ("benchmark", "case", "metric", "target", "direction", "peer", "peer_value",
                  "source")
KEY_COLUMNS = ("date", "commit", "machine", "benchmark", "case", "metric", "command")
Result = collections.namedtuple("Result", RESULT_COLUMNS)
Target = collections.namedtuple("Target", TARGET_COLUMNS)

# The unit of a metric follows from its name: the first ending that matches, statistic removed.
UNIT_OF_ENDING = (
    ("bytes_per_primitive", "B"), ("bytes_per_frame", "B"), ("bits_per_primitive", "bit"),
    ("bits_per_symbol", "bit"), ("mprims_per_s", "Mprimitive/s"),
    ("mprims_per_cpu_s", "Mprimitive/s"), ("mprims_per_device_s", "Mprimitive/s"),
    ("msymbols_per_s", "Msymbol/s"), ("images_per_s", "image/s"), ("inputs_per_s", "1/s"),
    ("kbit_per_s", "kbit/s"), ("mbit_per_s", "Mbit/s"), ("tb_per_s", "TB/s"),
    ("gflop_per_s", "GFLOP/s"), ("db", "dB"), ("ms", "ms"), ("us", "us"), ("s", "s"), ("px", "px"),
    ("bytes", "B"), ("mb", "MB"), ("mib", "MiB"), ("fps", "fps"), ("percent", "%"),
    ("ratio", "ratio"), ("deg", "deg"), ("mm", "mm"), ("units", "unit"), ("frames_off", "frame"),
    ("error", "1"), ("ssim", "1"), ("ssim_2", "1"), ("ssim_drop", "1"), ("ssim_gain", "1"),
    ("normal_loss", "1"), ("lpips", "1"))
UNITS = {unit for _, unit in UNIT_OF_ENDING} | {"count"}
EXACT_UNITS = {"B", "dB", "count", "1", "bit"}  # the same on each run of one build

STATISTIC = re.compile(r"_(p50|p95|p99|mean|median|min|max|rms|se)$")
HIGHER_IS_BETTER = re.compile(
    r"psnr|ssim|fps|per(_cpu|_device)?_s$|speedup|speed_vs|gain|passed|coverage")
LOWER_IS_BETTER = re.compile(r"drop|[km]bit_per_s")
NAME = re.compile(r"[a-z0-9]+([_.][a-z0-9]+)*")
DATE = re.compile(r"\d{4}-\d{2}-\d{2}")
COMMIT = re.compile(r"([0-9a-f]{7,40})?")
COMMENT = "  # "


def without_statistic(metric):
    while STATISTIC.search(metric):
        metric = STATISTIC.sub("", metric)
    return metric


def unit_of(metric):
    """The unit of a metric, by its name; a name without a unit is a count."""
    name = without_statistic(metric)
    if name.startswith("ratio_to_") or "_ratio_to_" in name:
        return "ratio"
    for ending, unit in UNIT_OF_ENDING:
        if name == ending or name.endswith("_" + ending):
            return unit
    return "count"


def higher_is_better(metric):
    name = without_statistic(metric)
    return bool(HIGHER_IS_BETTER.search(name)) and not LOWER_IS_BETTER.search(name)


def read_table(path, row_type):
    with open(path, encoding="utf-8", newline="") as file:
        lines = csv.reader(file)
        header = next(lines, [])
        if tuple(header) != row_type._fields:
            raise ValueError(f"{path}: columns are {','.join(header)} "
                             f"(expected {','.join(row_type._fields)})")
        rows = []
        for row in lines:
            if len(row) != len(header):
                raise ValueError(f"{path}:{lines.line_num}: {len(row)} columns "
                                 f"(expected {len(header)})")
            rows.append(row_type(*row))
        return rows


def read_results(path=RESULTS):
    return read_table(path, Result)


def read_targets(path=TARGETS):
    return read_table(path, Target)


def read_machines(path=MACHINES):
    with open(path, encoding="utf-8", newline="") as file:
        return {row["machine"]: row for row in csv.DictReader(file)}


def is_number(text):
    try:
        return float(text) - float(text) == 0
    except ValueError:
        return False


def result_problems(rows, machines):
    """Yields one line per problem of rows of results.csv."""
    seen = set()
    for number, row in enumerate(rows, 2):
        location = f"results.csv, row {number}"
        if not DATE.fullmatch(row.date):
            yield f"{location}: date '{row.date}' (expected YYYY-MM-DD)"
        if not COMMIT.fullmatch(row.commit):
            yield (f"{location}: commit '{row.commit}' "
                   "(expected 7 or more hexadecimal digits, or none)")
        if row.machine not in machines:
            yield f"{location}: machine '{row.machine}' is not in machines.csv"
        for name in (row.benchmark, row.case, row.metric):
            if not NAME.fullmatch(name):
                yield f"{location}: name '{name}' (expected snake_case)"
        if not is_number(row.value):
            yield f"{location}: value '{row.value}' (expected a finite number)"
        if row.unit not in UNITS or row.unit != unit_of(row.metric):
            yield (f"{location}: unit '{row.unit}' of {row.metric} "
                   f"(expected '{unit_of(row.metric)}')")
        if not row.command.split(COMMENT)[0].strip():
            yield f"{location}: no command"
        key = tuple(getattr(row, column) for column in KEY_COLUMNS)
        if key in seen:
            yield f"{location}: repeats {row.benchmark}/{row.case}/{row.metric} of the same command"
        seen.add(key)
    if [row.date for row in rows] != sorted(row.date for row in rows):
        yield "results.csv: rows are not in the order of their dates"


def target_problems(targets):
    seen = set()
    for number, row in enumerate(targets, 2):
        location = f"targets.csv, row {number}"
        if row.direction not in ("higher", "lower"):
            yield f"{location}: direction '{row.direction}' (expected higher or lower)"
        for name in (row.benchmark, row.case, row.metric):
            if not NAME.fullmatch(name):
                yield f"{location}: name '{name}' (expected snake_case)"
        if bool(row.peer) != bool(row.peer_value) or bool(row.peer) == bool(row.target):
            yield f"{location}: expected a target, or a peer and its value"
        elif not is_number(row.target or row.peer_value):
            yield f"{location}: '{row.target or row.peer_value}' (expected a finite number)"
        if not row.source:
            yield f"{location}: no source"
        key = row[:5] + (row.peer,)
        if key in seen:
            yield f"{location}: repeats a row above"
        seen.add(key)


def series(rows, machine, benchmark, case, metric):
    """The rows of one quantity on one machine, oldest first, without those of dropped trees."""
    return [row for row in rows
            if (row.machine, row.benchmark, row.case, row.metric)
            == (machine, benchmark, case, metric) and row.commit]


def latest(rows):
    """The rows of the last date and commit of a series."""
    return [row for row in rows if (row.date, row.commit) == (rows[-1].date, rows[-1].commit)]


def median(rows):
    return statistics.median(float(row.value) for row in rows)


def deviation(values):
    """The median absolute deviation, scaled to the standard deviation of a normal distribution."""
    middle = statistics.median(values)
    return 1.4826 * statistics.median(abs(value - middle) for value in values)
