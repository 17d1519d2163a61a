// The whole way in a real browser: a generated film, learning, a damaged file, a large one, two pages, a phone, the keyboard
// alone, a server that is killed.
//
// With PICTURES=FOLDER the pictures of docs/studio.md are made there: an absolute path, such as that of docs/studio.

import assert from "node:assert/strict";
import { cp, open as openFile, mkdtemp, readFile, readdir, rm, stat, writeFile } from "node:fs/promises";
import os from "node:os";
import path from "node:path";
import { after, before, test } from "node:test";
import { findings, kill, launch, open, peak, picture as draw, root, start, status } from "./server.mjs";

const PATIENCE = 300_000;
/// Bytes of a picture.
const PICTURE_BYTES = 8_500;
/// MB by which the server may grow while it receives 300.
const UPLOAD_MEMORY = 30;
/// Presses of Tab after which a control counts as out of reach.
const PRESSES = 120;
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

async function picture(name, of = page) {
  if (process.env.PICTURES) await draw(of, path.join(process.env.PICTURES, `${name}.webp`), PICTURE_BYTES);
}

/// Neither serious findings of axe-core nor faults of the page.
async function clean(name, of = page) {
  assert.deepEqual(await findings(of), [], name);
  assert.deepEqual(of.faults, [], name);
}

/// The same in light and in dark.
async function cleanInBoth(name) {
  await clean(`${name}, light`);
  await page.locator("#theme").click();
  await clean(`${name}, dark`);
  await page.locator("#theme").click();
}

/// Presses Tab until a control has the focus.
async function tabTo(selector) {
  for (let press = 0; press < PRESSES; press += 1) {
    if (await page.evaluate((it) => document.activeElement.matches(it), selector)) return;
    await page.keyboard.press("Tab");
  }
  assert.fail(`${selector} is not reached by Tab`);
}

async function downloaded(link, of = page) {
  const [download] = await Promise.all([of.waitForEvent("download"), of.getByRole("link", { name: link }).click()]);
  return [download.suggestedFilename(), await readFile(await download.path())];
}

/// Kills the server; a new one and a new page show the project.
async function restart(project) {
  await kill(running.server);
  running = await start(folder);
  await page.context().close();
  page = await open(browser, `${running.link}#/p/${project}`);
  page.setDefaultTimeout(PATIENCE);
}

const frameShown = () => page.locator("output.time").textContent();

async function latest(project) {
  const measurements = path.join(folder, project, "measurements");
  const last = (await readdir(measurements)).map(Number).sort((a, b) => b - a)[0];
  return JSON.parse(await readFile(path.join(measurements, String(last), "measurement.json"), "utf8"));
}

async function drag(selector, dx, dy) {
  // Marks are drawn anew meanwhile, so this is one look.
  const [x, y] = await page.evaluate((it) => {
    const box = document.querySelector(`${it} .knob`).getBoundingClientRect();
    return [box.x + box.width / 2, box.y + box.height / 2];
  }, selector);
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + dx, y + dy, { steps: 4 });
  await page.mouse.up();
}

test("the first view offers examples and holds no token in its address", async () => {
  await page.getByRole("heading", { name: "Measure the physics in your own video" }).waitFor();
  assert.equal(await page.locator("[data-example]").count(), 3);
  assert.equal(new URL(page.url()).search, "");
  await cleanInBoth("home");
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
  await drag("[data-handle=origin]", -40, -20);
  await page.waitForFunction((old) => document.querySelector(".command code").textContent !== old, first);
  await page.locator("[data-handle=stick-to]").focus();
  await page.keyboard.press("ArrowDown");
  await page.waitForFunction(() => / --scale 444,190,444,321,1 /.test(document.querySelector(".command code").textContent));
  await page.keyboard.press("ArrowUp");
  await page.waitForFunction(() => / --scale 444,190,444,320,1 /.test(document.querySelector(".command code").textContent));
  await page.evaluate(() => document.activeElement.blur());
  await cleanInBoth("set-up");
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
  await page.keyboard.press("Shift+ArrowRight");
  await page.keyboard.press("Shift+ArrowRight");
  await cleanInBoth("result");
  await picture("result");
});

test("a second page shows the same run", async () => {
  const other = await open(browser, `${running.link}#/p/a-thrown-ball`);
  await other.locator("[data-quantity=g]").waitFor({ timeout: PATIENCE });
  const [here, there] = await Promise.all([page, other].map((it) => it.locator("[data-quantity=g] td").first().textContent()));
  assert.equal(here, there);
  await other.context().close();
});

test("downloads are what was measured", async () => {
  const files = { "Page (HTML)": "measurement.html", "Positions (CSV)": "positions.csv", "Numbers (JSON)": "measurement.json", "Figure (PNG)": "measurement-positions.png", "Overlay (GIF)": "overlay.gif" };
  for (const [link, file] of Object.entries(files)) {
    const [name, bytes] = await downloaded(link);
    assert.equal(name, `a-thrown-ball-${file}`);
    assert.ok(bytes.equals(await readFile(path.join(folder, "a-thrown-ball/measurements/1", file))), file);
  }
});

test("a phone shows the result", async () => {
  const phone = await open(browser, `${running.link}#/p/a-thrown-ball`, { viewport: { width: 390, height: 844 }, isMobile: true, hasTouch: true });
  await phone.locator("[data-quantity=g]").waitFor({ timeout: PATIENCE });
  await phone.locator(".chart").first().waitFor();
  assert.equal(await phone.evaluate(() => document.documentElement.scrollWidth), 390);
  await clean("phone", phone);
  await picture("phone", phone);
  await phone.context().close();
});

test("a video that is too short to learn from is refused in words", async () => {
  await page.locator("#tab-learn").click();
  await page.locator("#train").click();
  await page.getByRole("heading", { name: "It failed" }).waitFor();
  assert.match(await page.locator(".verdict p").textContent(), /34 frames are too few/);
  assert.equal(await page.locator("#resume").count(), 0);
});

test("wrong tokens, hosts and paths are refused", async () => {
  const { port } = new URL(running.link);
  const [{ name, value }] = await page.context().cookies();
  const Cookie = `${name}=${value}`;
  assert.equal(await status(port, { headers: { Cookie } }), 200);
  assert.equal(await status(port, { headers: { Cookie: `${name}=0123` } }), 401);
  assert.equal(await status(port, { headers: { Cookie, Host: "evil.example" } }), 421);
  assert.equal(await status(port, { headers: { Cookie, Origin: "http://evil.example" } }), 403);
  assert.equal(await status(port, { headers: { Cookie }, path: "/api/projects/..%2F..%2Fetc" }), 404);
  assert.equal(await status(port, { headers: { Cookie }, path: "/api/projects/a-thrown-ball/measurements/1/..%2F..%2Fproject.json" }), 404);
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
});

test("a file of 300 MB goes to the disk, not into the server's memory", async () => {
  await page.locator(".brand").click();
  const before = await peak(running.server.pid);
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
  const grown = await peak(running.server.pid) - before;
  assert.ok(grown < UPLOAD_MEMORY, `${grown} MB`);
  assert.equal((await stat(path.join(folder, "large/source/large.mp4"))).size, video.length + 300_000_000);
  await clean("large");
});

test("a server that is killed loses nothing: the job goes on and a new server shows it", async () => {
  await page.locator(".brand").click();
  await page.locator("[data-example=pendulum]").click();
  await page.locator(".row.chosen").first().waitFor();
  await page.locator("#find").click();
  await page.getByRole("heading", { name: "Measuring …" }).waitFor();
  await restart("a-pendulum");
  await page.locator("[data-outcome]").waitFor();
  const measured = await latest("a-pendulum");
  const g = measured.quantities.find((it) => it.name === "g");
  assert.ok(Math.abs(g.value - 9.81) < 0.2, `${g.value}`);
  await clean("restarted");
});

test("by keys alone: another equation, its missing term, one press to measure with it", async () => {
  const outcome = () => page.waitForFunction(() => document.querySelector("[data-outcome]") && document.querySelector("#equation-taken").textContent);
  await page.goto(`${new URL(running.link).origin}/#/`);
  await page.getByRole("heading", { name: "Your projects" }).waitFor();
  await tabTo("a[href='#/p/a-pendulum']");
  await page.keyboard.press("Enter");
  await page.locator("[data-outcome]").waitFor();
  await tabTo("#tab-setup");
  await page.keyboard.press("Enter");
  await tabTo("[data-handle=origin]");
  for (const key of ["ArrowLeft", "ArrowRight"]) {
    const before = await page.locator(".command code").textContent();
    await page.keyboard.press(key);
    await page.waitForFunction((old) => document.querySelector(".command code").textContent !== old, before);
    assert.ok(await page.evaluate(() => document.activeElement.matches("[data-handle=origin]")), "the handle keeps the focus");
  }
  await tabTo("input[value=damped_pendulum]");
  await page.keyboard.press("ArrowDown");
  await page.waitForFunction(() => / --equation free_pendulum /.test(document.querySelector(".command code").textContent));
  await tabTo("#find");
  await page.keyboard.press("Enter");
  await page.getByRole("heading", { name: "Measuring …" }).waitFor();
  assert.match(await (await outcome()).jsonValue(), /Pendulum/);
  await picture("missing-term");
  await tabTo("#extend");
  await page.keyboard.press("Enter");
  await page.getByRole("heading", { name: "Measuring …" }).waitFor();
  assert.match(await (await outcome()).jsonValue(), /with the missing term/);
  const measured = await latest("a-pendulum");
  const g = measured.quantities.find((it) => it.name === "g");
  assert.ok(Math.abs(g.value - 9.81) < 0.2, `${g.value}`);
  await clean("missing term");
});

test("a measurement can be stopped", async () => {
  await page.locator("#tab-setup").click();
  await page.locator("#find").click();
  await page.getByRole("button", { name: "Stop" }).click();
  await page.getByRole("heading", { name: "No result" }).waitFor();
});

test("learning is shown live, on two pages, and is stopped and resumed", async () => {
  const live = async () => JSON.parse(await readFile(path.join(folder, "a-pendulum/trainings/1/live.json"), "utf8"));
  const drawn = (of) => of.waitForFunction(() => document.querySelector(".drawing")?.naturalWidth > 0);
  const steps = () => page.waitForFunction(() => document.querySelector(".working p")?.textContent.match(/step (\d+) of at most/)?.[1]).then((it) => it.jsonValue()).then(Number);
  await page.locator("#tab-learn").click();
  await page.locator("#train").click();
  await steps();
  await drawn(page);
  await page.locator(".working .quantities").waitFor();
  const other = await open(browser, `${running.link}#/p/a-pendulum`);
  other.setDefaultTimeout(PATIENCE);
  await other.locator("#tab-learn").click();
  await drawn(other);
  assert.equal(await other.locator("[data-phase]").getAttribute("data-phase"), "discover");
  await other.context().close();
  await cleanInBoth("learn");
  await page.locator(".drawing").evaluate((it) => it.scrollIntoView({ block: "end" }));
  await picture("learn");
  await page.locator("#stop-training").click();
  await page.getByRole("heading", { name: "Stopped" }).waitFor();
  const stopped = await live();
  const [name, archive] = await downloaded("Task folder (ZIP)");
  assert.equal(name, "a-pendulum-task.zip");
  assert.equal(archive.readUInt32LE(0), 0x04034b50);
  await page.locator("#resume").click();
  const resumed = await steps();
  assert.ok(stopped.done > 0 && resumed >= stopped.done, `${resumed} ${stopped.done}`);
  await restart("a-pendulum");
  await page.locator("#tab-learn").click();
  assert.ok((await steps()) >= resumed, "the training goes on without its server");
  await drawn(page);
  await page.locator("#stop-training").click();
  await page.getByRole("heading", { name: "Stopped" }).waitFor();
  await clean("stopped");
});

test("results of the commands are cards, too", async () => {
  await cp(path.join(folder, "a-thrown-ball/measurements/1"), path.join(folder, "by-command/throw"), { recursive: true });
  await page.goto(`${new URL(running.link).origin}/#/`);
  const card = page.locator(".result-card");
  await card.getByText("by-command/throw").waitFor();
  assert.match(await card.textContent(), /falling.*g = 9\.8.*m\/s².*found/);
  await page.waitForFunction(() => document.querySelector(".result-card img")?.naturalWidth > 0);
  const [shown] = await Promise.all([page.context().waitForEvent("page"), card.getByRole("link").click()]);
  await shown.getByText("m/s").first().waitFor();
  await shown.close();
  await clean("results of the commands");
});

test("projects are cards; deletion asks", async () => {
  await page.locator(".brand").click();
  await page.locator(".card.project").first().waitFor();
  const count = await page.locator(".card.project").count();
  const forget = page.getByRole("button", { name: "Delete A pendulum" });
  const asked = [];
  page.once("dialog", (dialog) => dialog.dismiss(asked.push(dialog.message())));
  await forget.click();
  assert.match(asked[0], /^Delete “A pendulum” with its video and all results/);
  assert.ok((await readdir(folder)).includes("a-pendulum"), "it was deleted without consent");
  await picture("projects");
  page.once("dialog", (dialog) => dialog.accept());
  await forget.click();
  await page.waitForFunction((old) => document.querySelectorAll(".card.project").length === old - 1, count);
  assert.equal((await readdir(folder)).includes("a-pendulum"), false);
  await clean("projects");
});
