// SPDX-License-Identifier: Apache-2.0
// Marks of the steps of loading, for the performance tools of browsers and tests/web/bench_load.py.

/**
 * The steps: the script of the page runs; its worker does; the core is compiled; the file is open; the
 * first read of content is complete; its first segment is decoded; the base layer of all that the first
 * image needs is; the renderer is ready; the page has passed the first segment to it; the page has drawn
 * the first image.
 */
export type LoadStep =
  "script" | "worker" | "compiled" | "opened" | "fetched" | "decoded" | "ready" | "renderer" | "uploaded" | "drawn";

export function markStep(step: LoadStep): void {
  performance.mark(`stgs: ${step}`);
}

/** Marks the steps of one source, each once. */
export class LoadMarks {
  private readonly marked = new Set<LoadStep>();

  mark(step: LoadStep): void {
    if (this.marked.has(step)) return;
    this.marked.add(step);
    markStep(step);
  }

  /** Another source begins. */
  reset(): void {
    this.marked.clear();
  }
}
