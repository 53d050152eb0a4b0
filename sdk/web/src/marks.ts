// SPDX-License-Identifier: Apache-2.0
// Marks of the steps of loading, for the performance tools of browsers and tests/web/bench_load.py.

/**
 * The steps, in the order of the type: the script of the page runs; its worker runs; the core is compiled;
 * the file is open; the first read of content is complete; the first segment is decoded; the base layer of
 * the first image is decoded; the renderer is ready; the first segment is uploaded; the first image is
 * drawn.
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

  /** Starts another source. */
  reset(): void {
    this.marked.clear();
  }
}
