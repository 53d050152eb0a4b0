// SPDX-License-Identifier: Apache-2.0
// Bundles TypeScript sources for tests in node.
import { execFileSync } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

const ROOT = join(dirname(fileURLToPath(import.meta.url)), "..", "..", "sdk", "web");

/** Imports a source, named relative to sdk/web, together with its imports. */
export async function importSource(source) {
  const folder = mkdtempSync(join(tmpdir(), "stgs-web-"));
  try {
    const output = join(folder, "bundle.mjs");
    const options = ["--bundle", "--format=esm", "--target=es2020", "--log-level=error"];
    execFileSync("esbuild", [join(ROOT, source), ...options, `--outfile=${output}`]);
    return await import(pathToFileURL(output).href);
  } finally {
    rmSync(folder, { recursive: true });
  }
}
