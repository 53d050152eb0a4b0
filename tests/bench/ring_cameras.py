# SPDX-License-Identifier: Apache-2.0
"""The eight cameras of the rendering benchmarks and of the figures of other renderers."""
import json
import math

COUNT = 8
WIDTH, HEIGHT = 3840, 2160


def unit(v):
    length = math.sqrt(sum(x * x for x in v))
    return [x / length for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def camera_at(angle):
    """From (10 cos, -1.3, 7 sin) to (0, -0.4, 0), y down, 60 degrees wide."""
    eye = [10 * math.cos(angle), -1.3, 7 * math.sin(angle)]
    forward = unit([-eye[0], -0.4 - eye[1], -eye[2]])
    right = unit(cross(forward, [0, -1, 0]))
    rows = [right, cross(forward, right), forward]
    focal = WIDTH / 2 / math.tan(math.radians(30))
    return {"width": WIDTH, "height": HEIGHT, "fx": focal, "fy": focal,
            "cx": WIDTH / 2, "cy": HEIGHT / 2, "rotation": sum(rows, []),
            "translation": [-sum(a * b for a, b in zip(row, eye)) for row in rows]}


def write_cameras(folder):
    """Writes c0.json to c7.json."""
    for i in range(COUNT):
        camera = camera_at(2 * math.pi * i / COUNT)
        (folder / f"c{i}.json").write_text(json.dumps(camera), encoding="utf-8")
