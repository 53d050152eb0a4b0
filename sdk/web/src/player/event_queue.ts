// SPDX-License-Identifier: Apache-2.0
import type { PlayerNotice } from "../types";
import type { QualityReport } from "./adaptation";

/** Events of the player: those of media elements, `notice`, and those of headsets, quality, sound and recordings. */
export const EVENT_NAMES = [
  "loadstart", "durationchange", "loadedmetadata", "loadeddata", "canplay", "play", "playing",
  "pause", "waiting", "seeking", "seeked", "timeupdate", "ratechange", "ended", "error", "progress",
  "abort", "emptied", "notice", "enterxr", "leavexr", "qualitychange",
  "volumechange", "audiochange", "livechange",
] as const;
export type EventName = typeof EVENT_NAMES[number];

/** The types of `detail`; other events have none. */
interface Details {
  notice: PlayerNotice;
  qualitychange: QualityReport;
}
type Detail<Name extends EventName> = Name extends keyof Details ? [detail: Details[Name]] : [];

/** Dispatches a copy of each event of a player to another target, unless `takes` returns true for it. */
export function forwardEvents(from: EventTarget, to: EventTarget, takes: (event: Event) => boolean): void {
  for (const name of EVENT_NAMES) {
    from.addEventListener(name, (event) => {
      if (takes(event)) return;
      to.dispatchEvent(event instanceof CustomEvent ? new CustomEvent(name, { detail: event.detail })
                                                    : new Event(name));
    });
  }
}

/**
 * Dispatches events in order, after the call that causes them has returned, as media elements do: a
 * listener that is added right after `load` receives `loadstart`.
 */
export class EventQueue {
  private events: Event[] | null = [];

  constructor(private readonly target: EventTarget) {}

  /** Queues an event; with `detail` it is a `CustomEvent`. */
  push<Name extends EventName>(name: Name, ...[detail]: Detail<Name>): void {
    if (this.events === null) return;
    this.events.push(detail === undefined ? new Event(name) : new CustomEvent(name, { detail }));
    if (this.events.length === 1) queueMicrotask(() => this.dispatch());
  }

  /** Discards all queued and later events. */
  close(): void {
    this.events = null;
  }

  private dispatch(): void {
    while (this.events !== null && this.events.length > 0) {
      const event = this.events[0];
      this.target.dispatchEvent(event);
      this.events?.shift();
    }
  }
}
