// SPDX-License-Identifier: Apache-2.0
import { create, setLabel } from "./dom";
import { RATES } from "./keyboard";
import { Media } from "./media";
import { formatRate } from "./text";

/** A button that shows the playback rate, with a menu of rates. */
export class SpeedMenu {
  readonly root: HTMLElement;
  private readonly button: HTMLButtonElement;
  private readonly menu: HTMLElement;
  private readonly items: HTMLElement[];

  constructor(private readonly media: Media) {
    this.button = create("button", {
      type: "button", class: "button speed", "aria-haspopup": "menu", "aria-expanded": "false",
    });
    this.items = RATES.map((rate) => {
      const text = rate === 1 ? "Normal" : formatRate(rate);
      const item = create("div", { role: "menuitemradio", tabindex: "-1", class: "item" }, text);
      item.addEventListener("click", () => this.choose(rate));
      return item;
    });
    const attributes = { role: "menu", class: "menu", "aria-label": "Speed" };
    this.menu = create("div", attributes, ...this.items);
    this.menu.hidden = true;
    this.root = create("div", { class: "speed-menu" }, this.menu, this.button);
    this.button.addEventListener("click", () => (this.isOpen ? this.close() : this.open()));
    this.root.addEventListener("keydown", (event) => this.onKey(event));
    this.root.addEventListener("focusout", (event) => {
      const next = event.relatedTarget;
      if (!(next instanceof Node && this.root.contains(next))) this.hide();
    });
    this.update();
  }

  get isOpen(): boolean {
    return !this.menu.hidden;
  }

  /** Shows the current rate. */
  update(): void {
    const rate = this.media.playbackRate;
    this.button.textContent = formatRate(rate);
    setLabel(this.button, `Speed, ${formatRate(rate)}`);
    this.items.forEach((item, i) => item.setAttribute("aria-checked", String(RATES[i] === rate)));
  }

  /** Hides the menu without moving the focus. */
  hide(): void {
    this.menu.hidden = true;
    this.button.setAttribute("aria-expanded", "false");
  }

  private open(): void {
    this.menu.hidden = false;
    this.button.setAttribute("aria-expanded", "true");
    const current = RATES.indexOf(this.media.playbackRate);
    this.focus(this.items[current < 0 ? RATES.indexOf(1) : current]);
  }

  /** Focuses an item and scrolls the menu, but not the page. */
  private focus(item: HTMLElement): void {
    item.focus({ preventScroll: true });
    this.menu.scrollTop = item.offsetTop + (item.offsetHeight - this.menu.clientHeight) / 2;
  }

  private close(): void {
    this.hide();
    this.button.focus({ preventScroll: true });
  }

  private choose(rate: number): void {
    this.media.playbackRate = rate;
    this.close();
  }

  /** The keys of the menu do not reach the player while it is open. */
  private onKey(event: KeyboardEvent): void {
    if (!this.isOpen) return;
    const focused = this.items.findIndex((item) => item.matches(":focus"));
    const last = this.items.length - 1;
    const target: Record<string, number> = {
      ArrowDown: focused >= last ? 0 : focused + 1,
      ArrowUp: focused <= 0 ? last : focused - 1,
      Home: 0,
      End: last,
    };
    if (event.key in target) this.focus(this.items[target[event.key]]);
    else if (event.key === "Enter" || event.key === " ") this.items[focused]?.click();
    else if (event.key === "Escape") this.close();
    else if (event.key === "Tab") return this.hide();
    event.preventDefault();
    event.stopPropagation();
  }
}
