// SPDX-License-Identifier: Apache-2.0
// The attribute `bridge`: origins of embedding pages that may control the element.
import { loadBridge } from "../bridge_loader";
import type { Exposable } from "../stgs-bridge";

/** Exposes an element while it is connected and has the attribute. */
export class BridgeAttribute {
  private current = new AbortController();

  /** `origins`: the value of the attribute, separated by spaces; null if it is not set. */
  update(element: Exposable, origins: string | null): void {
    this.current.abort();
    const { signal } = (this.current = new AbortController());
    const list = origins?.split(/\s+/).filter((origin) => origin !== "") ?? [];
    if (list.length === 0) return;
    loadBridge().then(({ expose }) => {
      if (!signal.aborted) signal.addEventListener("abort", expose(element, list));
    }).catch((error: unknown) => console.error("stgs: the attribute bridge has no effect:", error));
  }
}
