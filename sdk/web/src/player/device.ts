// SPDX-License-Identifier: Apache-2.0
// Budgets for the device of the page.

/** Classes of devices, with different budgets of memory and primitives. */
export type DeviceClass = "phone" | "headset" | "desktop";

/** The signals of the browser. */
export interface DeviceSignals {
  /** `navigator.userAgentData.mobile`; null: not reported. */
  mobile: boolean | null;
  userAgent: string;
  /** Maximum number of simultaneous touch points. */
  touchPoints: number;
  /** Whether `navigator.xr` exists. */
  hasXr: boolean;
  /** `navigator.deviceMemory`, GiB: rounded, and at most 8 in many browsers; null: not reported. */
  memory: number | null;
}

/** A device, and the budgets of a scene on it. */
export interface Device {
  kind: DeviceClass;
  /** The reason for `kind`, and the memory. */
  reason: string;
  /** Maximum bytes of fetched and decoded segments. */
  memoryBudget: number;
  /** Maximum number at one time. */
  maxPrimitives: number;
}

const MIB = 2 ** 20, M = 1e6;
/** GiB of memory: up to the first value is little, from the second value on is much. */
const LITTLE = 4, MUCH = 8;
/** Budgets (bytes, primitives) with little memory, with unknown memory, and with much. */
const BUDGETS: Record<DeviceClass, readonly (readonly [number, number])[]> = {
  phone: [[256 * MIB, M], [384 * MIB, 2 * M], [512 * MIB, 3 * M]],
  headset: [[256 * MIB, M], [256 * MIB, M], [256 * MIB, M]],
  desktop: [[256 * MIB, M], [512 * MIB, 3 * M], [768 * MIB, 5 * M]],
};
const HEADSETS = /Quest|OculusBrowser|Pico|Wolvic/;
const PHONES = /iPhone|iPad|iPod|Android/;

/** Reads the signals of the browser. Node, which has no navigator, counts as a desktop. */
export function deviceSignals(): DeviceSignals {
  const page = (typeof navigator === "undefined" ? {} : navigator) as Partial<Navigator> & {
    userAgentData?: { mobile?: boolean }; deviceMemory?: number;
  };
  return {
    mobile: page.userAgentData?.mobile ?? null, userAgent: page.userAgent ?? "",
    touchPoints: page.maxTouchPoints ?? 0, hasXr: "xr" in page, memory: page.deviceMemory ?? null,
  };
}

function kindOf({ mobile, userAgent, touchPoints, hasXr }: DeviceSignals): [DeviceClass, string] {
  if (hasXr && HEADSETS.test(userAgent)) return ["headset", "the browser of a headset"];
  if (mobile === true) return ["phone", "the browser reports a mobile device"];
  if (PHONES.test(userAgent)) return ["phone", "the user agent of a phone or tablet"];
  if (/Macintosh/.test(userAgent) && touchPoints > 1) return ["phone", "a tablet: a Mac with a touch screen"];
  return ["desktop", "no sign of a phone or headset"];
}

/** Returns the device for these signals. `chosen`: the class set by the page, if any. */
export function deviceOf(signals: DeviceSignals, chosen?: DeviceClass): Device {
  const [kind, why] = chosen ? [chosen, "chosen by the page"] as const : kindOf(signals);
  const { memory } = signals;
  const column = memory === null ? 1 : memory <= LITTLE ? 0 : memory >= MUCH ? 2 : 1;
  const [memoryBudget, maxPrimitives] = BUDGETS[kind][column]!;
  const stated = memory === null ? "memory not reported" : `${memory} GiB of memory`;
  return { kind, reason: `${why}; ${stated}`, memoryBudget, maxPrimitives };
}
