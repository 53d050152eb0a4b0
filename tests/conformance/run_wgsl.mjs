// SPDX-License-Identifier: Apache-2.0
// Runs decode.wgsl for check_wgsl.py on the default WebGPU adapter.
//
// usage: node run_wgsl.mjs WEBGPU SHADER     WEBGPU is the file of npm's module "webgpu"
//
// Prints a line with the adapter's name. Then it reads cases from stdin and writes their results to
// stdout, as u32. A case: the lengths of the buffers of bindings 0 to 6, then the contents of 0 to 4.
// Its result: the contents of 5 and 6. Exit code 77: there is no adapter.
import {readFileSync, writeSync} from 'node:fs';
import {pathToFileURL} from 'node:url';

const INPUTS = 5, BUFFERS = 7;
const [modulePath, shaderPath] = process.argv.slice(2);
const {create, globals} = await import(pathToFileURL(modulePath));
Object.assign(globalThis, globals);

// Reads n u32 from stdin; null at its end.
const chunks = process.stdin[Symbol.asyncIterator]();
let unread = Buffer.alloc(0);
async function read(n) {
  const parts = [unread];
  for (let have = unread.length; have < 4 * n;) {
    const {value, done} = await chunks.next();
    if (done) return null;
    parts.push(value);
    have += value.length;
  }
  const all = Buffer.concat(parts);
  unread = all.subarray(4 * n);
  return new Uint32Array(new Uint8Array(all.subarray(0, 4 * n)).buffer);
}

function write(bytes) {
  for (let at = 0; at < bytes.length;) {
    try {
      at += writeSync(1, bytes, at);
    } catch (error) {
      if (error.code !== 'EAGAIN') throw error;
    }
  }
}

async function run(device, pipeline, lengths) {
  const buffers = Array.from(lengths, (length) => device.createBuffer({
    size: 4 * Math.max(1, length),
    usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST | GPUBufferUsage.COPY_SRC,
  }));
  for (let i = 0; i < INPUTS; ++i) device.queue.writeBuffer(buffers[i], 0, await read(lengths[i]));
  const encoder = device.createCommandEncoder();
  const pass = encoder.beginComputePass();
  pass.setPipeline(pipeline);
  pass.setBindGroup(0, device.createBindGroup({
    layout: pipeline.getBindGroupLayout(0),
    entries: buffers.map((buffer, binding) => ({binding, resource: {buffer}})),
  }));
  pass.dispatchWorkgroups(lengths[BUFFERS - 1]);
  pass.end();
  const results = [];
  for (let i = INPUTS; i < BUFFERS; ++i) {
    results.push(device.createBuffer({
      size: buffers[i].size,
      usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST,
    }));
    encoder.copyBufferToBuffer(buffers[i], 0, results.at(-1), 0, buffers[i].size);
  }
  device.queue.submit([encoder.finish()]);
  for (const [i, result] of results.entries()) {
    await result.mapAsync(GPUMapMode.READ);
    write(new Uint8Array(result.getMappedRange().slice(0, 4 * lengths[INPUTS + i])));
  }
  for (const buffer of [...buffers, ...results]) buffer.destroy();
}

function fail(message) {
  console.error(message);
  process.exit(1);
}

globalThis.gpu = create([]);  // a global: the module crashes once it has been collected
const adapter = await gpu.requestAdapter();
if (adapter === null) process.exit(77);
const device = await adapter.requestDevice();
device.addEventListener('uncapturederror', (event) => fail(event.error.message));
const shader = device.createShaderModule({code: readFileSync(shaderPath, 'utf8')});
for (const {type, lineNum, message} of (await shader.getCompilationInfo()).messages) {
  fail(`${shaderPath}:${lineNum}: ${type}: ${message}`);
}
const pipeline = device.createComputePipeline({layout: 'auto', compute: {module: shader}});
write(Buffer.from(`${adapter.info.description || adapter.info.device || 'unnamed'}\n`));
for (;;) {
  const lengths = await read(BUFFERS);
  if (lengths === null) break;
  await run(device, pipeline, lengths);
}
process.exit(0);
