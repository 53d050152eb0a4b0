# SPDX-License-Identifier: Apache-2.0
"""Clauses 3.5 and 4: PRIV, META and WNDW."""
import math

from fields import Fields, need


def read_meta(file, payload):  # 4.2, 4.3
    fields = Fields(payload, "4.2")
    numerator, denominator, file.frames = fields.u32(), fields.u32(), fields.u32()
    kernel, axes, colour, sh = (fields.u8() for _ in range(4))
    file.profile = fields.u16()
    file.degree = fields.u16()
    background = [fields.f32() for _ in range(3)]
    minimum, maximum = [fields.f32() for _ in range(3)], [fields.f32() for _ in range(3)]
    near = fields.f32()
    width, height = fields.u32(), fields.u32()
    r, t = [fields.f32() for _ in range(9)], [fields.f32() for _ in range(3)]
    lens = [fields.f32() for _ in range(4)]
    fields.text()
    fields.text()
    metres, up, floor = fields.f32(), [fields.f32() for _ in range(3)], [fields.f32() for _ in range(3)]
    fields.text()
    audio_begin = fields.f64()
    need(axes == 0 and all(v == 0 or v >= 128 for v in (kernel, colour, sh)), "4.2",
         "an unknown convention", unsupported=True)
    need(numerator > 0 and denominator > 0 and file.frames > 0, "4.2", "a time base or duration of 0")
    need(file.degree <= 3, "4.2", f"SH degree {file.degree}", unsupported=True)
    need(all(map(math.isfinite, background + minimum + maximum + [near])) and near >= 0, "4.3",
         "a number that is not finite, or a near plane below 0")
    need(all(a <= b for a, b in zip(minimum, maximum)), "4.3", "inverted bounds")
    need(all(map(math.isfinite, up + floor + [metres])) and metres >= 0, "4.3", "the unit or the floor")
    need(not any(up) or abs(math.hypot(*up) - 1) <= 0.001, "4.3", "an up vector of another length")
    need(abs(audio_begin) <= 2.0 ** 32, "4.3", "the beginning of the audio")
    if (width, height) == (0, 0):
        return  # no start camera
    need(1 <= width <= 32768 and 1 <= height <= 32768, "4.3", "the start camera's size")
    need(all(map(math.isfinite, r + t + lens)) and lens[0] > 0 and lens[1] > 0, "4.3",
         "the start camera's numbers")
    rows = [r[0:3], r[3:6], r[6:9]]
    for i in range(3):
        for j in range(3):
            product = sum(a * b for a, b in zip(rows[i], rows[j]))
            need(abs(product - (i == j)) <= 0.001, "4.3", "the start camera's rotation")
    a, b, c = rows
    need(a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) +
         a[2] * (b[0] * c[1] - b[1] * c[0]) > 0, "4.3", "the start camera's rotation mirrors")


def read_private_names(payload):  # 3.5; only checked: this decoder knows no private numbers
    fields = Fields(payload, "3.5")
    for _ in range(fields.u16()):
        fields.u16()
        fields.u16()
        name = fields.bytes(fields.u32())
        try:
            need(name.decode("utf-8") != "", "3.5", "an empty name")
        except UnicodeDecodeError:
            need(False, "3.5", "a name that is not UTF-8")


def read_window(payload):  # 4.5
    fields = Fields(payload, "4.5")
    first, capture_frames = fields.u32(), fields.u32()
    fields.u64()
    fields.u64()
    return first, capture_frames
