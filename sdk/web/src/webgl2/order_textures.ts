// SPDX-License-Identifier: Apache-2.0
import { padded } from "../packed_segment";
import { allocateTexture, created, Table } from "./gl";
import { kRecordRow } from "./records";

/** An order on the GPU: its entries, and the segment of each group of 256 entries. */
export class OrderTextures {
  private readonly groups: Table;
  private readonly entries: WebGLTexture;
  private rows = 0; // of `entries`
  /** The number of entries. */
  count = 0;

  constructor(private readonly gl: WebGL2RenderingContext) {
    this.groups = new Table(gl, 1);
    this.entries = created(gl.createTexture(), "texture");
  }

  /**
   * Uploads an order: entries as those of Order, of segments that have `primitives` each and begin
   * at `bases`. Throws an Error if the GPU has no memory.
   */
  upload(entries: Uint32Array, primitives: number[], bases: number[]): void {
    this.gl.activeTexture(this.gl.TEXTURE0);
    this.uploadEntries(entries);
    const last = bases.length - 1;
    const total = last < 0 ? 0 : (bases[last] as number) + padded(primitives[last] as number);
    const groups = this.groups.stage(total / 256);
    bases.forEach((base, k) => {
      const first = base / 256;
      groups.fill(k, first, first + padded(primitives[k] as number) / 256);
    });
    this.groups.upload();
  }

  /** Binds the table of groups and the entries to two successive texture units. */
  bind(unit: number): void {
    this.groups.bind(unit);
    this.gl.activeTexture(this.gl.TEXTURE0 + unit + 1);
    this.gl.bindTexture(this.gl.TEXTURE_2D, this.entries);
  }

  destroy(): void {
    this.groups.destroy();
    this.gl.deleteTexture(this.entries);
  }

  /** Uploads whole rows, then the rest of the last one. */
  private uploadEntries(entries: Uint32Array): void {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.entries);
    this.count = 0;
    this.reserve(Math.ceil(entries.length / kRecordRow));
    const whole = Math.floor(entries.length / kRecordRow);
    const rest = entries.length - whole * kRecordRow;
    const put = (row: number, width: number, rows: number) => gl.texSubImage2D(
      gl.TEXTURE_2D, 0, 0, row, width, rows, gl.RED_INTEGER, gl.UNSIGNED_INT, entries, row * kRecordRow);
    if (whole > 0) put(0, kRecordRow, whole);
    if (rest > 0) put(whole, rest, 1);
    this.count = entries.length;
  }

  /** Makes the bound texture large enough. */
  private reserve(rows: number): void {
    if (rows <= this.rows) return;
    const { gl } = this;
    const enlarged = Math.max(rows, Math.ceil(1.25 * this.rows));
    this.rows = 0;
    if (!allocateTexture(gl, gl.R32UI, gl.RED_INTEGER, kRecordRow, enlarged)) {
      const primitives = rows * kRecordRow;
      throw new Error(`the GPU cannot hold an order of ${primitives} primitives; lower maxPrimitives`);
    }
    this.rows = enlarged;
  }
}
