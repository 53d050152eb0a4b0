// SPDX-License-Identifier: Apache-2.0
// The worker of the sorter: an entry point of its own, bundled to stgs-sorter.js.
import { DepthSorter } from "./sorter";
import type { SorterReply, SorterRequest } from "./sorter_messages";

/** The part of DedicatedWorkerGlobalScope that is used. */
interface Scope {
  onmessage: ((event: MessageEvent<SorterRequest>) => void) | null;
  postMessage(message: SorterReply, transfer: Transferable[]): void;
}

const scope = self as unknown as Scope;
const sorter = new DepthSorter();

scope.onmessage = ({ data }) => {
  switch (data.type) {
    case "add":
      sorter.add(data.segment);
      break;
    case "remove":
      sorter.remove(data.key);
      break;
    case "sort": {
      const start = performance.now();
      const order = sorter.sort(data.request, data.buffer);
      const milliseconds = performance.now() - start;
      scope.postMessage({ type: "order", order, milliseconds }, [order.buffer]);
      break;
    }
    case "words":
      for (const { key, words } of sorter.segments()) {
        const copy = words.slice(0);
        scope.postMessage({ type: "words", key, words: copy }, [copy]);
      }
      break;
  }
};
