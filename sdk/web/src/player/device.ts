// SPDX-License-Identifier: Apache-2.0
// Budgets for the device of the page.

/** Kinds of devices, which differ in the memory and the primitives that they can be expected to take. */
export type DeviceClass = "phone" | "headset" | "desktop";

/** The signals of the browser. */
export interface DeviceSignals {
  /** `navigator.userAgentData.mobile`; null: not stated. */
  mobile: boolean | null;
  userAgent: string;
  /** Fingers that the screen distinguishes. */
  touchPoints: number;
  /** Whether there is `navigator.xr`. */
  hasXr: boolean;
  /** GiB, as `navigator.deviceMemory` rounds them, at most 8 in many browsers; null: not stated. */
  memory: number | null;
}

/** A device, and what a scene may take on it. */
export interface Device {
  kind: DeviceClass;
  /** Why it counts as this kind. */
  reason: string;
  /** Bytes of fetched and decoded segments. */
  memoryBudget: number;
  /** At one time. */
  maxPrimitives: number;
}

const MIB = 2 ** 20, M = 1e6;
/** GiB of memory: at most this is little, at least that is much. */
const LITTLE = 4, MUCH = 8;
/** Budgets with little memory, if it is not stated, and with much: bytes, primitives. */
const BUDGETS: Record<DeviceClass, readonly (readonly [number, number])[]> = {
  phone: [[256 * MIB, M], [384 * MIB, 2 * M], [512 * MIB, 3 * M]],
  headset: [[256 * MIB, M], [256 * MIB, M], [256 * MIB, M]],
  desktop: [[256 * MIB, M], [512 * MIB, 3 * M], [768 * MIB, 5 * M]],
};
const HEADSETS = /Quest|OculusBrowser|Pico|Wolvic/;
const PHONES = /iPhone|iPad|iPod|Android/;

/** Reads the signals of a browser; node, which has no navigator, counts as a desktop. */
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
  if (hasXr && HEADSETS.test(userAgent)) return ["headset", "the browser is that of a headset"];
  if (mobile === true) return ["phone", "the browser states a mobile device"];
  if (PHONES.test(userAgent)) return ["phone", "the browser names a phone or a tablet"];
  if (/Macintosh/.test(userAgent) && touchPoints > 1) return ["phone", "a tablet with the browser of a Mac"];
  return ["desktop", "nothing states a phone or a headset"];
}

/** Returns the device of these signals; `chosen`: the kind that the page has chosen, if it has. */
export function deviceOf(signals: DeviceSignals, chosen?: DeviceClass): Device {
  const [kind, why] = chosen ? [chosen, "chosen by the page"] as const : kindOf(signals);
  const { memory } = signals;
  const column = memory === null ? 1 : memory <= LITTLE ? 0 : memory >= MUCH ? 2 : 1;
  const [memoryBudget, maxPrimitives] = BUDGETS[kind][column]!;
  const stated = memory === null ? "memory not stated" : `${memory} GiB of memory`;
  return { kind, reason: `${why}; ${stated}`, memoryBudget, maxPrimitives };
}
