// SPDX-License-Identifier: Apache-2.0
import { CoreMessage } from "../types";

/** Why playback failed, as the core reports it. */
export type ErrorReason = Extract<CoreMessage, { type: "error" }>["code"];

/** An error of playback, with the codes of the DOM's `MediaError`. */
export class PlayerError extends Error {
  static readonly MEDIA_ERR_ABORTED = 1;
  static readonly MEDIA_ERR_NETWORK = 2;
  static readonly MEDIA_ERR_DECODE = 3;
  static readonly MEDIA_ERR_SRC_NOT_SUPPORTED = 4;

  /** One of the constants above. */
  readonly code: number;
  readonly reason: ErrorReason;

  /** `isOpen`: whether the scene was open, so that an error of its format is one of decoding. */
  constructor(reason: ErrorReason, message: string, isOpen: boolean) {
    super(message);
    this.name = "PlayerError";
    this.reason = reason;
    this.code = codeOf(reason, isOpen);
  }
}

function codeOf(reason: ErrorReason, isOpen: boolean): number {
  switch (reason) {
    case "aborted":
      return PlayerError.MEDIA_ERR_ABORTED;
    case "network":
      return PlayerError.MEDIA_ERR_NETWORK;
    case "memory":
      return PlayerError.MEDIA_ERR_DECODE;
    case "format":
      return isOpen ? PlayerError.MEDIA_ERR_DECODE : PlayerError.MEDIA_ERR_SRC_NOT_SUPPORTED;
    case "unsupported":
    case "usage":
      return PlayerError.MEDIA_ERR_SRC_NOT_SUPPORTED;
  }
}

/** The reason of promises that a later call, an abort or `destroy` ended. */
export function abortError(message: string): DOMException {
  return new DOMException(message, "AbortError");
}

/** The reason of calls that the source or the player does not support. */
export function unsupported(message: string): DOMException {
  return new DOMException(message, "NotSupportedError");
}

const kDeviceLost = "DeviceLostError";

/** The failure of a renderer whose GPU device was lost; another renderer may succeed. */
export function deviceLost(message: string): Error {
  const error = new Error(message);
  error.name = kDeviceLost; // a name, because renderers are separate bundles with their own copy of a class
  return error;
}

export function isDeviceLost(error: unknown): error is Error {
  return error instanceof Error && error.name === kDeviceLost;
}

/** Anything that was thrown, as an Error. */
export function errorOf(thrown: unknown): Error {
  return thrown instanceof Error ? thrown : new Error(String(thrown));
}

/** The message of anything that was thrown. */
export function textOf(thrown: unknown): string {
  return errorOf(thrown).message;
}
