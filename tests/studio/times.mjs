// Response times of the page, and what it costs a training. Prints a table; asserts nothing, since times depend on the machine.
//
//   node times.mjs VIDEO_1080P VIDEO_720P

import { execFileSync, spawn } from "node:child_process";
import { cp, mkdtemp, readFile, rm } from "node:fs/promises";
import os from "node:os";
import path from "node:path";
import { kill, launch, open, program, start } from "./server.mjs";

const PATIENCE = 600_000;
const REPEATS = 3;
const JUMPS = 40;
/// Steps between which a training's processor time is taken.
const STEPS = [40, 240];
const SECOND = 1000;

const [fullHd, hd] = process.argv.slice(2);
if (!hd) throw new Error("expected a video of 1080p and one of 720p");
const ticks = Number(execFileSync("getconf", ["CLK_TCK"]));
const wait = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
const folder = path.join(await mkdtemp(path.join(os.tmpdir(), "paig-times-")), "projects");
const browser = await launch();
const { server, link } = await start(folder);
const page = await open(browser, link);
page.setDefaultTimeout(PATIENCE);

function quantiles(values) {
  const sorted = [...values].sort((a, b) => a - b);
  return `median ${Math.round(sorted[Math.floor(sorted.length / 2)])} ms, longest ${Math.round(sorted.at(-1))} ms`;
}

async function shown(video) {
  await page.goto(`${new URL(link).origin}/#/`);
  await page.locator("#file").waitFor({ state: "attached" });
  const begun = performance.now();
  await page.locator("#file").setInputFiles(video);
  await page.locator("canvas[data-frame]").waitFor();
  return performance.now() - begun;
}

const firstFrames = [];
for (let repeat = 0; repeat < REPEATS; repeat += 1) {
  firstFrames.push(await shown(fullHd));
  // The pictures of the rest are another matter.
  await page.locator(".row, .wrong").first().waitFor();
}
console.log(`first frame, 1080p, from the choice of the file: ${quantiles(firstFrames)}`);

await shown(hd);
await page.locator(".row, .wrong").first().waitFor();
const jumps = await page.evaluate(async (count) => {
  const scrub = document.querySelector(".scrub");
  const canvas = document.querySelector("canvas");
  const times = [];
  for (let jump = 0; jump < count; jump += 1) {
    // Far apart, so that no picture is loaded yet.
    const frame = (37 + 61 * jump) % (Number(scrub.max) + 1);
    const begun = performance.now();
    scrub.value = frame;
    scrub.dispatchEvent(new Event("input"));
    while (canvas.dataset.frame !== String(frame)) await new Promise(requestAnimationFrame);
    times.push(performance.now() - begun);
  }
  return times;
}, JUMPS);
console.log(`scrubbing, 720p, ${JUMPS} jumps: ${quantiles(jumps)}`);

/// Seconds of processor time of a process and its threads.
async function processorTime(pid) {
  const fields = (await readFile(`/proc/${pid}/stat`, "utf8")).split(") ")[1].split(" ");
  return (Number(fields[11]) + Number(fields[12])) / ticks;
}

/// Processor time for a step, between two numbers of steps.
async function costOfStep(pid, steps, seen = () => {}) {
  const marks = [];
  while (marks.length < STEPS.length) {
    const done = await steps();
    await seen();
    if (done >= STEPS[marks.length]) marks.push([done, await processorTime(pid)]);
    await wait(50);
  }
  const [[first, before], [last, after]] = marks;
  return (SECOND * (after - before)) / (last - first);
}

async function plain(task, number) {
  const out = path.join(path.dirname(folder), `plain-${number}`);
  const training = spawn(program, ["train", "--task", task, "--out", out], { stdio: "ignore" });
  const steps = async () => {
    const text = await readFile(path.join(out, "metrics.jsonl"), "utf8").catch(() => "");
    const lines = text.trim().split("\n").filter(Boolean);
    return lines.length ? JSON.parse(lines.at(-1)).step : 0;
  };
  const cost = await costOfStep(training.pid, steps);
  await kill(training);
  return cost;
}

await page.goto(`${new URL(link).origin}/#/`);
await page.locator("[data-example=pendulum]").click();
await page.locator(".row.chosen").first().waitFor();
await page.locator("#tab-learn").click();
const costs = { plain: [], page: [], server: [] };
const between = [];
for (let number = 1; number <= REPEATS; number += 1) {
  await page.locator("#train, .result > button.small").last().click();
  const training = path.join(folder, "a-pendulum/trainings", String(number));
  await page.waitForFunction(() => document.querySelector(".working p")?.textContent.includes("step"));
  const live = async () => JSON.parse(await readFile(path.join(training, "live.json"), "utf8"));
  const pid = Number(await readFile(path.join(training, "job.pid"), "utf8"));
  let [pictures, last] = [0, undefined];
  const served = await processorTime(server.pid);
  const begun = performance.now();
  costs.page.push(await costOfStep(pid, async () => (await live()).done, async () => {
    const now = (await live()).pictures;
    if (now === pictures) return;
    if (last !== undefined) between.push(performance.now() - last);
    [pictures, last] = [now, performance.now()];
  }));
  costs.server.push((100 * (await processorTime(server.pid) - served)) / ((performance.now() - begun) / SECOND));
  await page.locator("#stop-training").click();
  await page.getByRole("heading", { name: "Stopped" }).waitFor();
  const task = path.join(path.dirname(folder), `task-${number}`);
  await cp(path.join(training, "task"), task, { recursive: true });
  costs.plain.push(await plain(path.join(task, "task.toml"), number));
}
const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
console.log(`preview while training: ${quantiles(between)} between two (${between.length})`);
const spread = (values) => values.map((value) => value.toFixed(1)).join(", ");
console.log(`processor time of a step: ${spread(costs.page)} ms with the page, ${spread(costs.plain)} ms by paig train: ${(100 * (mean(costs.page) / mean(costs.plain) - 1)).toFixed(1)} % more`);
console.log(`the server meanwhile: ${spread(costs.server)} % of one core`);
await browser.close();
await kill(server, "SIGTERM");
await rm(path.dirname(folder), { recursive: true, force: true });
