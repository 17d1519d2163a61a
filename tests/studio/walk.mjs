// The whole way in a real browser: a generated film, a damaged file, a large one, two pages, a server that is killed.
//
// With PICTURES=FOLDER the pictures of docs/studio.md are made there.

import assert from "node:assert/strict";
import { open as openFile, mkdtemp, readFile, readdir, rm, writeFile } from "node:fs/promises";
import os from "node:os";
import path from "node:path";
import { after, before, test } from "node:test";
import { findings, kill, launch, open, root, start } from "./server.mjs";

const PATIENCE = 180_000;
let folder;
let browser;
let running;
let page;

before(async () => {
  folder = path.join(await mkdtemp(path.join(os.tmpdir(), "paig-studio-")), "projects");
  browser = await launch();
  running = await start(folder);
  page = await open(browser, running.link);
  page.setDefaultTimeout(PATIENCE);
});

after(async () => {
  await browser?.close();
  if (running) await kill(running.server, "SIGTERM");
  await rm(path.dirname(folder), { recursive: true, force: true });
});

async function picture(name) {
  if (process.env.PICTURES) await page.screenshot({ path: path.join(process.env.PICTURES, `${name}.jpg`), type: "jpeg", quality: 62 });
}

async function clean(name) {
  assert.deepEqual(await findings(page), [], name);
  assert.deepEqual(page.faults, [], name);
}

const frameShown = () => page.locator("output.time").textContent();

async function latest(project) {
  const measurements = path.join(folder, project, "measurements");
  const last = (await readdir(measurements)).map(Number).sort((a, b) => b - a)[0];
  return JSON.parse(await readFile(path.join(measurements, String(last), "measurement.json"), "utf8"));
}

async function drag(locator, dx, dy) {
  const box = await locator.locator(".knob").boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + dx, y + dy, { steps: 4 });
  await page.mouse.up();
}

test("the first view offers examples and holds no token in its address", async () => {
  await page.getByRole("heading", { name: "Measure the physics in your own video" }).waitFor();
  assert.equal(await page.locator("[data-example]").count(), 3);
  assert.equal(new URL(page.url()).search, "");
  await clean("home");
  await picture("home");
});

test("a thrown ball is proposed, set up by dragging and stepped through by keys", async () => {
  await page.locator("[data-example=throw]").click();
  await page.locator(".row.chosen").first().waitFor();
  await page.locator("canvas[data-frame]").waitFor();
  await page.keyboard.press("ArrowRight");
  const before = Number((await frameShown()).match(/frame (\d+)/)[1]);
  await page.keyboard.press("ArrowRight");
  const [, frame, seconds] = (await frameShown()).match(/frame (\d+) of \d+ · ([\d.]+) s/);
  assert.equal(Number(frame), before + 1);
  // Times are shown to a millisecond.
  assert.ok(Math.abs(Number(seconds) - Number(frame) / 30) < 1e-3, seconds);
  const command = page.locator(".command code");
  const first = await command.textContent();
  await drag(page.locator("[data-handle=origin]"), -40, -20);
  await page.waitForFunction((old) => document.querySelector(".command code").textContent !== old, first);
  await page.locator("[data-handle=stick-to]").focus();
  await page.keyboard.press("ArrowDown");
  await page.waitForFunction(() => / --scale 444,190,444,321,1 /.test(document.querySelector(".command code").textContent));
  await page.keyboard.press("ArrowUp");
  await page.waitForFunction(() => / --scale 444,190,444,320,1 /.test(document.querySelector(".command code").textContent));
  await page.evaluate(() => document.activeElement.blur());
  await clean("set-up");
  await picture("set-up");
});

test("the result equals measurement.json and finds gravity", async () => {
  await page.locator("#find").click();
  await page.locator("[data-outcome]").waitFor();
  await page.locator(".chart").first().waitFor();
  const measured = await latest("a-thrown-ball");
  const g = measured.quantities.find((it) => it.name === "g");
  const shown = await page.locator("[data-quantity=g] td").first().textContent();
  const half = 0.5 * (g.high - g.low);
  // What is shown is rounded to two digits of the interval.
  assert.ok(Math.abs(parseFloat(shown) - g.value) <= 0.1 * half, `${shown} ${g.value}`);
  // 9.81 m/s^2 within what a ball of JPEG pixels allows.
  assert.ok(Math.abs(g.value - 9.81) < 0.1, `${g.value}`);
  assert.equal(await page.locator("[data-outcome]").getAttribute("data-outcome"), measured.verdict.outcome);
  assert.equal(await page.locator(".overlay .now").count() > 0, true);
  await page.keyboard.press("ArrowRight");
  await clean("result");
  await picture("result");
});

test("dark colours pass the same checks", async () => {
  await page.locator("#theme").click();
  await page.evaluate(() => window.scrollTo(0, 400));
  await clean("dark");
  await picture("dark");
  await page.locator("#theme").click();
});

test("a second page shows the same run", async () => {
  const other = await open(browser, `${running.link}#/p/a-thrown-ball`);
  await other.locator("[data-quantity=g]").waitFor({ timeout: PATIENCE });
  const [here, there] = await Promise.all([page, other].map((it) => it.locator("[data-quantity=g] td").first().textContent()));
  assert.equal(here, there);
  await other.context().close();
});

test("downloads are what was measured", async () => {
  const wait = page.waitForEvent("download");
  await page.getByRole("link", { name: "Numbers (JSON)" }).click();
  const download = await wait;
  assert.equal(download.suggestedFilename(), "a-thrown-ball-measurement.json");
  assert.deepEqual(JSON.parse(await readFile(await download.path(), "utf8")), await latest("a-thrown-ball"));
});

test("a damaged file is refused in words, its name is no markup", async () => {
  await page.locator(".brand").click();
  const bad = path.join(path.dirname(folder), "<img src=x onerror=alert(1)>.mp4");
  await writeFile(bad, Buffer.alloc(5000, 7));
  await page.locator("#file").setInputFiles(bad);
  await page.getByRole("heading", { name: "This file could not be read" }).waitFor();
  assert.ok((await page.locator(".wrong").textContent()).length > 20);
  assert.equal(await page.locator("#where img").count(), 0);
  await clean("damaged");
  await picture("damaged");
});

test("a file of 300 MB is taken", async () => {
  await page.locator(".brand").click();
  const large = path.join(path.dirname(folder), "large.mp4");
  const video = await readFile(path.join(root, "tests/data/numbered.mp4"));
  // A box of free space that players pass over.
  const free = Buffer.alloc(8);
  free.writeUInt32BE(300_000_000);
  free.write("free", 4);
  const file = await openFile(large, "w");
  await file.write(video);
  await file.write(free);
  await file.truncate(video.length + 300_000_000);
  await file.close();
  await page.locator("#file").setInputFiles(large);
  await page.locator("canvas[data-frame]").waitFor();
  await clean("large");
});

test("a server that is killed loses nothing: the job goes on and a new server shows it", async () => {
  await page.locator(".brand").click();
  await page.locator("[data-example=pendulum]").click();
  await page.locator(".row.chosen").first().waitFor();
  await page.locator("#find").click();
  await page.getByRole("heading", { name: "Measuring …" }).waitFor();
  await kill(running.server);
  running = await start(folder);
  await page.context().close();
  page = await open(browser, `${running.link}#/p/a-pendulum`);
  page.setDefaultTimeout(PATIENCE);
  await page.locator("[data-outcome]").waitFor();
  await picture("pendulum");
  const measured = await latest("a-pendulum");
  const g = measured.quantities.find((it) => it.name === "g");
  assert.ok(Math.abs(g.value - 9.81) < 0.2, `${g.value}`);
  await clean("restarted");
});

test("a measurement can be stopped", async () => {
  await page.locator("#tab-setup").click();
  await page.locator("#find").click();
  await page.getByRole("button", { name: "Stop" }).click();
  await page.getByRole("heading", { name: "No result" }).waitFor();
});

test("projects are cards and can be deleted", async () => {
  await page.locator(".brand").click();
  await page.locator(".card.project").first().waitFor();
  const count = await page.locator(".card.project").count();
  await picture("projects");
  page.on("dialog", (dialog) => dialog.accept());
  await page.getByRole("button", { name: "Delete A pendulum" }).click();
  await page.waitForFunction((old) => document.querySelectorAll(".card.project").length === old - 1, count);
  assert.equal((await readdir(folder)).includes("a-pendulum"), false);
  await clean("projects");
});
