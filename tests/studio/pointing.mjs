// Filmed videos measured by pointing alone, beside the command line's results in reports/real/results.json.
//
//   node pointing.mjs FOLDER [NAME ..]
//
// FOLDER holds the videos under the names of reports/real/videos.toml. Prints the rows of the table of docs/studio.md.

import { mkdtemp, readFile, readdir, rm } from "node:fs/promises";
import os from "node:os";
import path from "node:path";
import { kill, launch, open, root, start } from "./server.mjs";

const PATIENCE = 600_000;
/// The equation that is clicked.
const CLIPS = [
  { name: "tennis_bounce", file: "more/tennis_bounce/tennis_ball_cropped.mp4", equation: "bounce_on_a_floor" },
  { name: "pdi_throw", file: "more/pdi_throw/tiro.mp4", equation: "falling" },
  { name: "lilvit_projectile", file: "more/lilvit_projectile/video.mp4", equation: "falling" },
  { name: "alejo_incline", file: "more/alejo_incline/Video.mp4", equation: "constant_acceleration" },
  { name: "pym_puck_force", file: "more/pym_puck_force/Force_constante.avi", equation: "constant_acceleration" },
  { name: "arz_bounce_gif", file: "more/arz_bounce_gif/balloriginalgif.gif", equation: "bounce_on_a_floor" },
];

const [videos, ...names] = process.argv.slice(2);
if (!videos) throw new Error("expected the folder of the videos");

/// Points at one clip; its project's folder, the equation that was proposed, and seconds until each view.
async function measure(page, projects, clip) {
  const before = new Set(await readdir(projects).catch(() => []));
  const begun = performance.now();
  const since = () => ((performance.now() - begun) / 1000).toFixed(1);
  await page.locator(".brand").click();
  await page.locator("#file").setInputFiles(path.join(videos, clip.file));
  await page.locator("canvas[data-frame]").waitFor();
  const seconds = { frame: since() };
  await page.locator(".row").first().waitFor();
  seconds.proposals = since();
  const proposed = await page.locator(".choice", { has: page.locator(".likely") }).locator("input").first().getAttribute("value");
  await page.locator(`input[value=${clip.equation}]`).click();
  await page.locator("#find").click();
  await page.locator("[data-outcome], .verdict").first().waitFor();
  seconds.result = since();
  await page.locator(".chart").first().waitFor();
  const name = (await readdir(projects)).find((it) => !before.has(it));
  return { folder: path.join(projects, name), proposed, seconds };
}

const commandLine = JSON.parse(await readFile(path.join(root, "reports/real/results.json"), "utf8"));
const round = (value) => Number(value.toPrecision(4));
const cell = (it) => (it ? `${round(it.value)} [${round(it.low)}, ${round(it.high)}]` : "–");

const projects = path.join(await mkdtemp(path.join(os.tmpdir(), "paig-pointing-")), "projects");
const browser = await launch();
const { server, link } = await start(projects);
const page = await open(browser, link, { viewport: { width: 1280, height: 900 } });
page.setDefaultTimeout(PATIENCE);
for (const clip of CLIPS.filter((it) => !names.length || names.includes(it.name))) {
  const { folder, proposed, seconds } = await measure(page, projects, clip);
  const found = JSON.parse(await readFile(path.join(folder, "measurements/1/measurement.json"), "utf8"));
  const command = await readFile(path.join(folder, "measurements/1/command.txt"), "utf8");
  console.error(clip.name, { proposed, ...seconds }, command.replaceAll(projects, ""), found.verdict.reasons);
  for (const quantity of found.quantities) {
    const other = commandLine.find((it) => it.clip === clip.name && it.quantity === quantity.name);
    console.log(`| ${clip.name} | ${found.verdict.outcome} | ${quantity.name}, ${quantity.unit} | ${cell(quantity)} | ${cell(other)} |`);
  }
}
await browser.close();
await kill(server, "SIGTERM");
await rm(path.dirname(projects), { recursive: true, force: true });
