// SPDX-License-Identifier: Apache-2.0
import type { Order, SorterSegment, SortRequest } from "./sorter";

/** Messages to the worker. The buffers are transferred. */
export type SorterRequest =
  | { type: "add"; segment: SorterSegment }
  | { type: "remove"; key: number }
  /** `buffer`: of an earlier order, to be used again. */
  | { type: "sort"; request: SortRequest; buffer: ArrayBuffer | null }
  /** Returns a copy of the words of every segment, in messages of their own. */
  | { type: "words" };

/** Messages of the worker. The buffers are transferred. */
export type SorterReply =
  /** `milliseconds`: time of the sort. */
  | { type: "order"; order: Order; milliseconds: number }
  | { type: "words"; key: number; words: ArrayBuffer };
