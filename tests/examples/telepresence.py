# SPDX-License-Identifier: Apache-2.0
"""The examples telepresence_recorder and telepresence_viewer, with nginx between them."""
import json
import os
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../fetch"))
from nginx import Nginx  # noqa: E402


def run(recorder, viewer, seconds, join_after, stretch=0.5):
    """Records so many seconds in real time, and joins when `join_after` seconds are there. What the
    viewer prints, with `stretches`: what the recorder does."""
    with tempfile.TemporaryDirectory() as folder, Nginx(folder) as server:
        with subprocess.Popen([recorder, folder + "/scene.stgs", str(seconds), str(stretch)],
                              stdout=subprocess.PIPE, text=True) as recording:
            try:
                lines = []
                while not lines or json.loads(lines[-1])["end"] < join_after:
                    lines.append(recording.stdout.readline())
                watched = subprocess.run([viewer, server.url, str(seconds + 20)], check=True,
                                         stdout=subprocess.PIPE, text=True, timeout=seconds + 60)
                lines += recording.stdout.readlines()
            finally:
                recording.kill()
    out = json.loads(watched.stdout)
    out["stretches"] = [json.loads(line) for line in lines]
    return out


def run_replaced(recorder, viewer, seconds):
    """Joins a recording, in whose place another is put once it is seen to be followed. What the
    viewer prints."""
    def record(path):
        return subprocess.Popen([recorder, path, str(seconds)], stdout=subprocess.PIPE, text=True)
    with tempfile.TemporaryDirectory() as folder:
        path, other = folder + "/scene.stgs", folder + "/other.stgs"
        with record(path) as first:
            first.stdout.readline()
            with subprocess.Popen([viewer, path, str(seconds + 20)], stdout=subprocess.PIPE,
                                  text=True) as viewing, record(other) as second:
                try:
                    for _ in range(3):
                        second.stdout.readline()
                    first.kill()
                    os.replace(other, path)
                    second.wait(seconds + 30)
                    told = viewing.communicate(timeout=60)[0]
                finally:
                    for process in first, second, viewing:
                        process.kill()
        if viewing.returncode != 0:
            raise RuntimeError(f"the viewer ended with {viewing.returncode}")
        return json.loads(told)


def percentile(values, share):
    return sorted(values)[min(int(share * len(values)), len(values) - 1)] if values else None


def latencies(out):
    """Of the stretches that were appended after joining: from when a stretch was over, and from when
    it was in the file, until a picture of it was drawn; and by how much pictures were late."""
    joined = out["shown"][0][1]
    visible, after_append, late = [], [], []
    for stretch in out["stretches"]:
        shown = [at for moment, at in out["shown"] if stretch["begin"] <= moment < stretch["end"]]
        if stretch["captured"] < joined or not shown:
            continue
        visible.append(shown[0] - stretch["captured"])
        after_append.append(shown[0] - stretch["appended"])
        start = stretch["captured"] - stretch["end"]  # when moment 0 was
        late += [at - start - moment for moment, at in out["shown"]
                 if stretch["begin"] <= moment < stretch["end"]]
    return visible, after_append, late


def measure(recorder, viewer, seconds, joins):
    """Figures of one long recording, and of joining several."""
    out = run(recorder, viewer, seconds, join_after=seconds / 4)
    figures = {name: {"p50": percentile(values, 0.5), "p95": percentile(values, 0.95)}
               for name, values in zip(("over_to_visible_s", "append_to_visible_s", "late_s"),
                                       latencies(out))}
    figures["stretches"] = len(latencies(out)[0])
    figures["events"] = out["events"]
    joined = [out["joined"]] + [run(recorder, viewer, 5, join_after=2)["joined"]
                                for _ in range(joins - 1)]
    figures["join_s"] = {"p50": percentile(joined, 0.5), "p95": percentile(joined, 0.95)}
    return figures


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit("usage: telepresence.py RECORDER VIEWER SECONDS JOINS")
    print(json.dumps(measure(*map(os.path.abspath, sys.argv[1:3]), float(sys.argv[3]),
                             int(sys.argv[4])), indent=1))
