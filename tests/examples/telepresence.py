# SPDX-License-Identifier: Apache-2.0
"""Runs the examples telepresence_recorder or telepresence_cameras, and telepresence_viewer, with nginx
between them.

usage: telepresence.py RECORDER VIEWER SECONDS JOINS     prints latencies as JSON
"""
import json
import os
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../fetch"))
from nginx import Nginx  # noqa: E402


def run(recorder, viewer, seconds, join_after, options=("0.5",)):
    """Records `seconds` in real time, and starts the viewer after `join_after` recorded seconds.
    Returns the viewer's JSON, with the recorder's lines as `fragments`."""
    with tempfile.TemporaryDirectory() as folder, Nginx(folder) as server:
        with subprocess.Popen([recorder, folder + "/scene.stgs", str(seconds), *options],
                              stdout=subprocess.PIPE, text=True) as recording:
            try:
                lines = []
                while not lines or json.loads(lines[-1])["end"] < join_after:
                    lines.append(recording.stdout.readline())
                viewing = subprocess.run([viewer, server.url, str(seconds + 100)], check=True,
                                         stdout=subprocess.PIPE, text=True, timeout=seconds + 140)
                lines += recording.stdout.readlines()
            finally:
                recording.kill()
    out = json.loads(viewing.stdout)
    out["fragments"] = [json.loads(line) for line in lines]
    return out


def run_replaced(recorder, viewer, seconds):
    """Replaces a recording by another one while a viewer follows it. Returns the viewer's JSON."""
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
                    output = viewing.communicate(timeout=60)[0]
                finally:
                    for process in first, second, viewing:
                        process.kill()
        if viewing.returncode != 0:
            raise RuntimeError(f"the viewer exited with {viewing.returncode}")
        return json.loads(output)


def percentile(values, share):
    return sorted(values)[min(int(share * len(values)), len(values) - 1)] if values else None


def latencies(out):
    """Returns latencies in seconds of the fragments appended after joining: from the end of capture
    to the first frame shown, from the append to the first frame shown, and that of each frame."""
    joined = out["shown"][0][1]
    visible, after_append, late = [], [], []
    for fragment in out["fragments"]:
        shown = [at for time, at in out["shown"] if fragment["begin"] <= time < fragment["end"]]
        if fragment["captured"] < joined or not shown:
            continue
        visible.append(shown[0] - fragment["captured"])
        after_append.append(shown[0] - fragment["appended"])
        start = fragment["captured"] - fragment["end"]  # clock at time 0 of the recording
        late += [at - start - time for time, at in out["shown"]
                 if fragment["begin"] <= time < fragment["end"]]
    return visible, after_append, late


def measure(recorder, viewer, seconds, joins):
    """Returns percentiles of the latencies of one long recording and of joining several."""
    out = run(recorder, viewer, seconds, join_after=seconds / 4)
    figures = {name: {"p50": percentile(values, 0.5), "p95": percentile(values, 0.95)}
               for name, values in zip(("fragment_end_to_visible_s", "append_to_visible_s", "latency_s"),
                                       latencies(out))}
    figures["fragments"] = len(latencies(out)[0])
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
