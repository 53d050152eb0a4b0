# SPDX-License-Identifier: Apache-2.0
"""Clauses 3.5 and 4: META and the records of the head that are not critical."""
import math
from dataclasses import dataclass, field

from fields import Fields, Refused, need


@dataclass
class Meta:  # 4.2
    time_base: tuple = ()
    frames: int = 0
    kernel: int = 0
    axes: int = 0
    sh: int = 0
    degree: int = 0
    profile: int = 0
    primaries: int = 0
    transfer: int = 0
    background: list = field(default_factory=list)
    bounds: list = field(default_factory=list)     # minimum, maximum
    near: float = 0.0
    size: tuple = ()
    pose: list = field(default_factory=list)       # rotation, translation, fx fy cx cy
    generator: bytes = b""
    title: bytes = b""
    metres: float = 0.0
    up: list = field(default_factory=list)
    floor: list = field(default_factory=list)
    audio: bytes = b""
    audio_begin: float = 0.0


def finite(values):
    return all(map(math.isfinite, values))


def check_bounds(bounds, clause, number):  # 4.3
    need(finite(bounds), clause, number, "bounds that are not finite")
    need(all(bounds[i] <= bounds[i + 3] for i in range(3)), clause, number, "a minimum above its maximum")


def read_meta(payload):
    f = Fields(payload, "4.2", 200)
    m = Meta((f.u32(), f.u32()), f.u32(), f.u8(), f.u8(), f.u8(), f.u8(), f.u16(), f.u8(), f.u8(),
             f.f32s(3), f.f32s(6), f.f32(), (f.u32(), f.u32()), f.f32s(16), f.text(205), f.text(205),
             f.f32(), f.f32s(3), f.f32s(3), f.text(205), f.f64())
    need((m.kernel <= 1 or m.kernel >= 128) and (m.sh == 0 or m.sh >= 128) and m.axes == 0, "4.2", 201,
         f"kernel {m.kernel}, axes {m.axes}, SH {m.sh}")
    need(m.time_base[0] > 0 and m.time_base[1] > 0 and m.frames > 0, "4.2", 202, "a time base or duration of 0")
    need(m.degree <= 3, "4.2", 203, f"SH degree {m.degree}")
    need(finite(m.background + [m.near] + m.pose + [m.metres] + m.up + m.floor), "4.3", 204,
         "a number that is not finite")
    check_bounds(m.bounds, "4.3", 204)
    need(m.near >= 0, "4.2", 204, f"a near plane at {m.near}")
    need(m.metres >= 0, "4.2", 204, f"{m.metres} metres per unit")
    need(not any(m.up) or abs(math.hypot(*m.up) - 1) <= 0.001, "4.3", 204, f"up is {m.up}")
    need(abs(m.audio_begin) <= 2.0 ** 32, "4.3", 204, f"audio from {m.audio_begin} on")
    if m.size != (0, 0):
        check_camera(m)
    return m


def check_camera(m):  # 4.3
    need(all(1 <= v <= 32768 for v in m.size), "4.3", 204, f"a start camera of {m.size}")
    need(m.pose[12] > 0 and m.pose[13] > 0, "4.3", 204, "a focal length of the start camera")
    a, b, c = rows = m.pose[0:3], m.pose[3:6], m.pose[6:9]
    for i in range(3):
        for j in range(3):
            product = sum(x * y for x, y in zip(rows[i], rows[j]))
            need(abs(product - (i == j)) <= 0.001, "4.3", 204, "the start camera's rotation")
    need(determinant(a, b, c) > 0, "4.3", 204, "the start camera's rotation mirrors")


def determinant(a, b, c):
    return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + \
        a[2] * (b[0] * c[1] - b[1] * c[0])


def check_shown(m, reports):
    """Reports unknown numbers that are displayed as known ones (4.2, 4.4)."""
    if m.kernel >= 128 or m.sh >= 128:
        reports.append(Refused("4.2", 201, f"kernel {m.kernel} and SH {m.sh} are displayed as 0"))
    if m.primaries not in (1, 9, 12) or m.transfer not in (1, 8, 13):
        reports.append(Refused("4.4", 208, f"colours {m.primaries}, {m.transfer} are displayed as BT.709, sRGB"))


def read_private_names(payload):  # 3.5
    f = Fields(payload, "3.5", 117)
    names = []
    for _ in range(f.u16()):
        kind, number, name = f.u16(), f.u16(), f.text()
        need(name != b"", "3.5", 117, "an empty name")
        if kind <= 2:
            names.append((kind, number, name))
    return names


def read_window(payload, frames):  # 4.5
    f = Fields(payload, "4.5", 206)
    window = f.u32(), f.u32(), f.u64(), f.u64()
    need(window[0] + frames <= window[1], "4.5", 206, "a window outside its capture")
    return window


def read_error_bounds(payload):  # 4.7
    f = Fields(payload, "4.7", 207)
    bounds = [(f.u16(), f.f32(), f.f32()) for _ in range(f.u16())]
    for _, greatest, rms in bounds:
        need(0 <= greatest < math.inf and 0 <= rms < math.inf, "4.7", 207,
             f"error bounds {greatest} and {rms}")
    return bounds
