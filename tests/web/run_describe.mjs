// SPDX-License-Identifier: Apache-2.0
// Runs describe_vectors (tests/conformance), compiled to WebAssembly, with files in memory: in a worker
// of a browser (run_describe.py), or in node with the arguments of the native program:
//   node run_describe.mjs PROGRAM.mjs [--floats] {[--max-memory N] FILE}...

/**
 * Runs the program of a module of emscripten, `create`. `files`: their names and bytes. Returns what
 * it prints; throws if it fails.
 */
export async function describe(create, wasmBinary, args, files) {
  const output = [], errors = [];
  const program = await create({
    wasmBinary, print: (line) => output.push(line), printErr: (line) => errors.push(line),
  });
  for (const [name, bytes] of files) {
    program.FS.mkdirTree(name.slice(0, name.lastIndexOf("/")));
    program.FS.writeFile(name, bytes);
  }
  const code = program.callMain(args);
  if (code !== 0) throw new Error(`describe_vectors exited with ${code}: ${errors.join("\n")}`);
  return output.map((line) => line + "\n").join("");
}

async function main([path, ...args]) {
  const { existsSync, readFileSync, writeSync } = await import("node:fs");
  const { resolve } = await import("node:path");
  const { pathToFileURL } = await import("node:url");
  globalThis.self = { location: { href: "" } }; // emscripten's code is for workers
  const { default: create } = await import(pathToFileURL(resolve(path)));
  const files = args.filter((name) => name.includes("/") && existsSync(name)).map((name) => [name, readFileSync(name)]);
  const output = Buffer.from(await describe(create, readFileSync(path.replace(/mjs$/, "wasm")), args, files));
  for (let done = 0; done < output.length;) done += writeSync(1, output, done);
}

if (globalThis.process?.argv[1] === new URL(import.meta.url).pathname) await main(process.argv.slice(2));
