// SPDX-License-Identifier: Apache-2.0
// The page of stgs serve and stgs web. Texts of files and links only ever become text of the page.
import { setResources } from "../index";
import type { StgsPlayerElement } from "../element/stgs_player";
import { formatBytes, formatCount } from "../element/text";
import { markStep } from "../marks";
import { textOf } from "../player/errors";
import { listenForFiles } from "./files";
import { importModel } from "./import_model";
import { inlinedAudio, inlinedResources, inlinedScene } from "./inlined";
import { showList } from "./list";
import { checkedList, isModel, linkedScene, nameOf, PageSettings, parseSettings, withoutEnding } from "./sources";

const LOADING_INTERVAL = 200; // milliseconds between two reports

let opened = 0; // files, of which the last one is shown
let settings: PageSettings = {}; // of this page

function element<T extends HTMLElement = HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}

/** Shows one of the page's states: the player, the invitation to choose a file, or the list. */
function showPage(shown: "stage" | "welcome" | "scenes"): void {
  for (const id of ["stage", "welcome", "scenes"]) element(id).hidden = id !== shown;
  element("open").hidden = shown === "welcome";
  document.body.classList.toggle("plays", shown === "stage");
  document.body.classList.remove("idle"); // of the player before
}

/** Sets the title of the page, and of the scene that it shows. */
function setTitle(title: string, scene: string): void {
  document.title = title;
  element("title").textContent = scene;
}

function setDetail(text: string): void {
  element("detail").textContent = text;
}

/**
 * Plays a scene in a new player. `name`: its title, unless it is the name of a file that states one.
 * `audio`: URL of its audio file; null: the one that it names.
 */
function play(source: URL | Blob, name: string, isFileName = true, audio: string | null = null): void {
  const player = document.createElement("stgs-player");
  if (settings.bridge !== undefined) player.setAttribute("bridge", settings.bridge);
  if (audio !== null) player.audio = audio;
  player.controls = true;
  player.loop = true;
  player.autoplay = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (source instanceof URL) player.src = source.href;
  else player.srcObject = source;
  setTitle(name, name);
  player.addEventListener("loadedmetadata", () => {
    const title = (isFileName && player.info!.title) || name;
    setTitle(title, title);
  });
  showProgress(player, source instanceof URL && source.origin !== location.origin ? ` from ${source.host}` : "");
  document.body.classList.remove("idle");
  new MutationObserver(() => document.body.classList.toggle("idle", player.hasAttribute("idle")))
    .observe(player, { attributeFilter: ["idle"] });
  element("stage").replaceChildren(player);
  showPage("stage");
}

/** Shows how loading advances, below the title. `origin`: where the scene comes from. */
function showProgress(player: StgsPlayerElement, origin: string): void {
  let timer: number | undefined;
  const stop = (detail: string) => {
    clearInterval(timer);
    setDetail(detail);
  };
  const update = () => {
    if (!player.isConnected) return clearInterval(timer); // another scene has taken its place
    const { bytesFetched } = player.stats;
    setDetail(`Loading${origin}${bytesFetched > 0 ? ` · ${formatBytes(bytesFetched)}` : "…"}`);
  };
  setDetail(`Loading${origin}…`);
  player.addEventListener("loadstart", () => {
    clearInterval(timer);
    timer = window.setInterval(update, LOADING_INTERVAL);
  });
  player.addEventListener("loadeddata", () => stop(`${formatCount(player.info!.primitives)} primitives${origin}`));
  player.addEventListener("error", () => stop("")); // the player shows the message
}

/** Invites to choose a file; `problem` states why no scene is shown, or is "". */
function welcome(problem: string): void {
  setTitle("STGS", "");
  setDetail("");
  element("problem").textContent = problem;
  element("problem").hidden = problem === "";
  element("stage").replaceChildren();
  showPage("welcome");
}

/** Plays a file that the visitor opens. */
function open(file: File, canImport: boolean): void {
  const name = withoutEnding(file.name);
  const count = ++opened;
  if (!isModel(file.name)) return play(file, name);
  if (!canImport) return welcome(`${file.name}: this page plays .stgs files; convert the model with 'stgs convert'.`);
  setTitle(name, name);
  setDetail("Converting…");
  element("stage").replaceChildren();
  showPage("stage");
  const isLast = () => count === opened;
  importModel(file).then(
    (scene) => isLast() && play(scene, name),
    (error: unknown) => isLast() && welcome(`${textOf(error)}.`));
}

/** Offers no models: a page of one file does not contain their conversion. */
function offerScenesOnly(): void {
  element("formats").textContent = "An .stgs video, from any viewpoint.";
  element<HTMLInputElement>("file").accept = ".stgs";
}

async function list(url: string): Promise<void> {
  showPage("scenes");
  setTitle("Scenes", "");
  setDetail("");
  try {
    const response = await fetch(new URL(url, document.baseURI));
    if (!response.ok) throw new Error(`the server answers with status ${response.status}`);
    showList(checkedList(await response.json()), element("list"), element("note"));
  } catch (error) {
    element("note").textContent = `The scenes cannot be listed: ${(error as Error).message}. Load the page again.`;
    element("note").hidden = false;
  }
}

/** Shows the scene of the link, else that of the page, else the list, else the invitation. */
function start(): void {
  const src = new URLSearchParams(location.search).get("src");
  element("back").hidden = settings.list === undefined || src === null;
  if (src !== null) {
    const url = linkedScene(src, document.baseURI);
    if (url !== null) return play(url, nameOf(url));
    return welcome(`The link names a scene that this page must not load: ${src}. Use an https address, or a file of the same server.`);
  }
  const inlined = inlinedScene();
  if (inlined !== null) return play(inlined, document.title, false, inlinedAudio());
  if (settings.scene !== undefined) {
    const url = new URL(settings.scene, document.baseURI);
    return play(url, document.title, false);
  }
  if (settings.list !== undefined) return void list(settings.list);
  welcome("");
}

async function main(): Promise<void> {
  markStep("script");
  const resources = await inlinedResources();
  if (resources !== null) {
    setResources(resources);
    offerScenesOnly();
  }
  listenForFiles({
    input: element<HTMLInputElement>("file"),
    buttons: [element("open"), element("choose")],
    hint: element("drop"),
    onFile: (file) => open(file, resources === null),
  });
  settings = parseSettings(element("stgs-page").textContent ?? "{}");
  start();
}

main().catch((error: unknown) => welcome(`The page is incomplete: ${textOf(error)}. Make it again with stgs web.`));
