// SPDX-License-Identifier: Apache-2.0
import { execFileSync } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

/** Bundles a module of sdk/web/src, without its extension, and imports it. */
export async function importSource(module) {
  const source = join(dirname(fileURLToPath(import.meta.url)), "..", "src", `${module}.ts`);
  const folder = mkdtempSync(join(tmpdir(), "stgs-web-"));
  try {
    const out = join(folder, "module.mjs");
    execFileSync("esbuild", [source, "--bundle", "--format=esm", "--target=es2020",
      "--log-level=warning", `--outfile=${out}`]);
    return await import(pathToFileURL(out).href);
  } finally {
    rmSync(folder, { recursive: true });
  }
}
