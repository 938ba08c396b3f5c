// Opens the store that zarrita_dump wrote and compares what zarrita reads, bit for bit, with what
// the engine read: node check.mjs FOLDER
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { FileSystemStore } from "@zarrita/storage";
import * as zarr from "zarrita";

const folder = path.resolve(process.argv[2]);
const expected = JSON.parse(await readFile(path.join(folder, "expected.json"), "utf8"));
const store = new FileSystemStore(path.join(folder, "a.zarr"));
const root = await zarr.open.v3(store, { kind: "group" });

const openArray = (name) => zarr.open.v3(root.resolve(name), { kind: "array" });

async function checkGroup() {
  const { fovea } = root.attrs;
  assert.equal(fovea.format_version, 2);
  assert.equal(fovea.wavelet, "haar");
  assert.equal(fovea.committed_steps, expected.steps.length);
  assert.deepEqual(fovea.dims_xyz, expected.dims_xyz);
  assert.deepEqual(Object.keys(fovea.fields).sort(), ["density", "heat"]);
  await zarr.open.v3(root.resolve("density"), { kind: "group" });
}

/// The number of which u is the folded form (docs/formats/store.md).
const unfold = (u) => (u % 2 === 0 ? u / 2 : -(u + 1) / 2);

async function checkWindow({ array: name, shape, step, window, values }) {
  const array = await openArray(name);
  const isFolded = name.startsWith("heat/");
  assert.equal(array.dtype, isFolded ? "uint16" : "float32");
  assert.equal(array.attrs.signs, isFolded ? "folded" : undefined);
  assert.deepEqual(array.shape, shape, name);
  assert.deepEqual(
    array.dimensionNames,
    shape.length === 5 ? ["t", "band", "z", "y", "x"] : ["t", "z", "y", "x"],
  );
  const read = await zarr.get(array, [step, ...window.map(([from, to]) => zarr.slice(from, to))]);
  const wanted = await readFile(path.join(folder, values));
  assert.deepEqual(read.shape, window.map(([from, to]) => to - from));
  const data = isFolded ? Float32Array.from(read.data, unfold) : read.data;
  const got = Buffer.from(data.buffer, data.byteOffset, data.byteLength);
  assert.ok(got.equals(wanted), `${name}, step ${step}: not the values that the engine reads`);
  return wanted.some((byte) => byte !== 0);
}

async function readSeries(name) {
  const array = await openArray(name);
  const { data, shape } = await zarr.get(array);
  assert.equal(shape[0], expected.steps.length, name);
  return data;
}

async function checkSteps() {
  const [time, frame, stats, histogram] = await Promise.all(
    ["time", "frame_number", "density/stats", "density/histogram"].map(readSeries),
  );
  expected.steps.forEach((step, t) => {
    assert.equal(time[t], BigInt(step.time_ns));
    assert.equal(frame[t], step.frame_number === null ? -(2n ** 63n) : BigInt(step.frame_number));
    assert.deepEqual([...stats.slice(2 * t, 2 * t + 2)], [step.minimum, step.maximum]);
    assert.deepEqual([...histogram.slice(256 * t, 256 * t + 256)].map(Number), step.histogram);
  });
}

/// chunk_max_W holds the largest |coefficient| of each chunk.
async function checkTable(width) {
  const [table, detail] = await Promise.all(
    ["chunk_max", "detail"].map(async (kind) => {
      const array = await openArray(`density/${kind}_${width}`);
      return zarr.get(array, [1, ...array.shape.slice(1).map(() => null)]);
    }),
  );
  const edge = root.attrs.fovea.chunk_edge;
  const largest = new Float32Array(table.data.length);
  const [bands, depth, height, length] = detail.shape;
  for (let at = 0; at < detail.data.length; ++at) {
    const row = Math.floor(at / length);
    const [z, y, x] = [Math.floor(row / height) % depth, row % height, at % length];
    const [cz, cy, cx] = [z, y, x].map((i) => Math.floor(i / edge));
    const entry = (cz * table.shape[1] + cy) * table.shape[2] + cx;
    largest[entry] = Math.max(largest[entry], Math.abs(detail.data[at]));
  }
  assert.equal(bands, 7);
  assert.deepEqual(table.data, largest);
}

await checkGroup();
const anything = await Promise.all(expected.windows.map(checkWindow));
assert.ok(anything.filter(Boolean).length > anything.length / 2, "most windows are all zeros");
await checkSteps();
for (const width of [2, 4, 8, 16]) {
  await checkTable(width);
}
const count = expected.windows.length;
console.log(`zarrita read ${count} windows as the engine does, under Node ${process.version}`);
