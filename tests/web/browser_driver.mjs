// SPDX-License-Identifier: Apache-2.0
// Drives a page of Chromium by Playwright: reads commands from the standard input and writes replies to
// the standard output, in JSON, one per line.
//   {"id", "method", "arguments"}   calls a method of an object below, as in "mouse.move"
//   {"id", "value", "problems"}     the reply, or with "error" instead of "value". problems: exceptions
//                                   and errors that the page logged since the last reply
// The first reply has the id 0: the page is ready. At the end of the input, Chromium is killed and its
// temporary profile removed.
// usage: node browser_driver.mjs CHROMIUM [FLAG...]
import { createInterface } from "node:readline";
import { chromium } from "../../build/npm/node_modules/playwright-core/index.mjs";

const [executablePath, ...args] = process.argv.slice(2);
const objects = {};
let problems = [];

// Objects that are not values, such as Playwright's, become {} or a short description.
function reply(id, result) {
  process.stdout.write(`${JSON.stringify({ id, ...result, problems })}\n`);
  problems = [];
}

async function start() {
  const context = await chromium.launchPersistentContext("", { executablePath, args, viewport: null, timeout: 0 });
  context.setDefaultTimeout(0); // browser.py has the limits
  const [page] = context.pages();
  page.on("pageerror", (error) => problems.push(String(error.stack ?? error)));
  page.on("console", (message) => {
    // Chromium's own messages, of files that are missing, have no arguments.
    if (message.type() === "error" && message.args().length > 0) problems.push(message.text());
  });
  const end = (message) => {
    console.error(message);
    process.exit(1);
  };
  page.on("crash", () => end("the page crashed"));
  context.on("close", () => end("Chromium ended"));
  const browser = context.browser();
  Object.assign(objects, { page, mouse: page.mouse, keyboard: page.keyboard, browser,
                           session: await context.newCDPSession(page),
                           browserSession: await browser.newBrowserCDPSession() });
}

async function answer(id, run) {
  try {
    reply(id, { value: await run() });
  } catch (error) {
    reply(id, { error: error.message });
  }
}

createInterface({ input: process.stdin })
  .on("line", (line) => {
    const { id, method, arguments: values } = JSON.parse(line);
    const [object, name] = method.split(".");
    answer(id, () => objects[object][name](...values));
  })
  .on("close", () => process.exit()); // Playwright kills Chromium
answer(0, start);
