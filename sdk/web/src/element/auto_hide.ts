// SPDX-License-Identifier: Apache-2.0

const IDLE_AFTER = 2500; // milliseconds without input
const LEFT_AFTER = 600; // milliseconds after the pointer left

/** Decides whether the controls are visible: while paused, and for a while after input. */
export class AutoHide {
  private timer: number | null = null;
  private plays = false;
  private isHidden = false;

  /** `mayHide` is asked before the controls hide; `onChange` shows or hides them. */
  constructor(
    private readonly mayHide: () => boolean,
    private readonly onChange: (hidden: boolean) => void,
  ) {}

  get hidden(): boolean {
    return this.isHidden;
  }

  /** While nothing plays, the controls stay visible. */
  setPlaying(plays: boolean): void {
    this.plays = plays;
    this.wake();
  }

  /** There was input. */
  wake(): void {
    this.set(false);
    this.schedule(IDLE_AFTER);
  }

  /** The pointer left the player. */
  leave(): void {
    if (!this.isHidden) this.schedule(LEFT_AFTER);
  }

  /** A touch: shows the controls, or hides them if they are visible. */
  tap(): void {
    if (this.isHidden) this.wake();
    else this.hide();
  }

  stop(): void {
    if (this.timer !== null) window.clearTimeout(this.timer);
    this.timer = null;
  }

  private schedule(milliseconds: number): void {
    this.stop();
    if (this.plays) this.timer = window.setTimeout(() => this.hide(), milliseconds);
  }

  private hide(): void {
    if (!this.plays) return;
    if (this.mayHide()) this.set(true);
    else this.schedule(IDLE_AFTER);
  }

  private set(hidden: boolean): void {
    if (hidden === this.isHidden) return;
    this.isHidden = hidden;
    this.onChange(hidden);
  }
}
