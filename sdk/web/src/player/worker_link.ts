// SPDX-License-Identifier: Apache-2.0
import { CoreMessage, PageMessage } from "../types";
import { WorkerLike } from "./host";

/** A worker, or a function that creates one for each source before it is opened. */
export type WorkerSource = WorkerLike | ((source: string | Blob) => WorkerLike);

/** The worker of the current source. Messages of earlier workers are ignored. */
export class WorkerLink {
  private worker: WorkerLike | null = null;
  private expectsOpened = false;
  private isOpen = false;

  constructor(
    private readonly source: WorkerSource,
    private readonly onMessage: (message: CoreMessage) => void,
    private readonly onFailure: (message: string) => void,
  ) {}

  /**
   * Prepares a worker for the next source. Passes on exceptions of the function that creates workers.
   */
  start(source: string | Blob): void {
    if (typeof this.source === "function") {
      this.worker?.terminate();
      this.worker = null;
      this.worker = this.attach(this.source(source));
    } else if (this.worker === null) {
      this.worker = this.attach(this.source);
    }
    this.expectsOpened = true;
    this.isOpen = true;
  }

  post(message: PageMessage): void {
    if (this.isOpen) this.worker?.postMessage(message);
  }

  /** Closes the source. Its messages that still arrive are ignored. */
  close(): void {
    this.post({ type: "close" });
    this.isOpen = false;
  }

  terminate(): void {
    this.isOpen = false;
    this.worker?.terminate();
    if (this.worker === null && typeof this.source !== "function") this.source.terminate();
    this.worker = null;
  }

  private attach(worker: WorkerLike): WorkerLike {
    const isCurrent = () => worker === this.worker && this.isOpen;
    worker.addEventListener("message", ({ data }) => {
      if (!isCurrent()) return;
      if (data.type === "opened") this.expectsOpened = false;
      // A worker that is used again may have posted these for the source before.
      const isStale = this.expectsOpened && data.type !== "error" && data.type !== "problem";
      if (!isStale) this.onMessage(data);
    });
    worker.addEventListener("error", ({ message }) => {
      if (isCurrent()) this.onFailure(message || "its script could not be loaded");
    });
    return worker;
  }
}
