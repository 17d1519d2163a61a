// `paig studio` as a process, and the browser that looks at it.

import { spawn } from "node:child_process";
import { existsSync } from "node:fs";
import { readFile, writeFile } from "node:fs/promises";
import http from "node:http";
import { createRequire } from "node:module";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";

export const root = path.resolve(path.dirname(fileURLToPath(import.meta.url)), "../..");
export const program = process.env.PAIG ?? path.join(root, "target/release/paig");
const browsers = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];
const axe = createRequire(import.meta.url).resolve("axe-core");

/// Starts the server in a folder; resolves once it has printed its link.
export function start(folder, options = []) {
  const server = spawn(program, ["studio", "--no-open", "--folder", folder, ...options], { cwd: path.dirname(folder) });
  return new Promise((resolve, reject) => {
    let text = "";
    const read = (bytes) => {
      text += bytes;
      const link = text.match(/http:\/\/127\.0\.0\.1:\d+\/\?token=\w+\S*/)?.[0];
      if (link) resolve({ server, link });
    };
    server.stdout.on("data", read);
    server.stderr.on("data", read);
    server.on("exit", (code) => reject(new Error(`paig studio ended with ${code}: ${text}`)));
  });
}

export function kill(server, signal = "SIGKILL") {
  const ended = new Promise((resolve) => server.removeAllListeners("exit").on("exit", resolve));
  server.kill(signal);
  return ended;
}

export function launch() {
  const executablePath = browsers.find((it) => it && existsSync(it));
  if (!executablePath) throw new Error("no Chromium: install Debian's package chromium, or set CHROMIUM to the program");
  return chromium.launch({ executablePath, args: ["--no-sandbox"] });
}

/// A page that notes requests to other hosts and errors of its scripts.
export async function open(browser, link, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1040, height: 700 }, colorScheme: "light", ...options });
  const page = await context.newPage();
  page.faults = [];
  const { host } = new URL(link);
  page.on("request", (request) => {
    const url = new URL(request.url());
    if (!["blob:", "data:"].includes(url.protocol) && url.host !== host) page.faults.push(`request to ${url.host}`);
  });
  page.on("pageerror", (error) => page.faults.push(`script: ${error.message}`));
  page.on("console", (message) => {
    if (message.text().includes("Content Security Policy")) page.faults.push(message.text());
  });
  await page.goto(link);
  return page;
}

/// Size of a picture's pixels, of the page's.
const SCALE = 0.7;

/// A picture of what the page shows, at most so many bytes.
export async function picture(page, file, most) {
  const cdp = await page.context().newCDPSession(page);
  const clip = { x: 0, y: await page.evaluate(() => window.scrollY), ...page.viewportSize(), scale: SCALE };
  let bytes;
  for (let quality = 80; quality > 0 && !(bytes?.length <= most); quality -= 5) {
    const { data } = await cdp.send("Page.captureScreenshot", { format: "webp", quality, clip });
    bytes = Buffer.from(data, "base64");
  }
  await writeFile(file, bytes);
}

/// Status of a request that the page would not send.
export function status(port, options) {
  return new Promise((resolve, reject) => {
    const request = http.request({ host: "127.0.0.1", port, path: "/api/projects", ...options }, (response) => {
      response.resume();
      resolve(response.statusCode);
    });
    request.on("error", reject);
    request.end();
  });
}

/// Largest memory of a process so far, MB.
export async function peak(pid) {
  const text = await readFile(`/proc/${pid}/status`, "utf8");
  return Number(text.match(/VmHWM:\s+(\d+) kB/)[1]) / 1024;
}

/// Findings of axe-core that are serious or critical, in words.
export async function findings(page) {
  // The page's policy forbids scripts from elsewhere, the tool's own included.
  const cdp = await page.context().newCDPSession(page);
  await cdp.send("Runtime.evaluate", { expression: await readFile(axe, "utf8") });
  const { result } = await cdp.send("Runtime.evaluate", { expression: "axe.run().then((it) => JSON.stringify(it.violations))", awaitPromise: true, returnByValue: true });
  const serious = JSON.parse(result.value).filter((it) => ["serious", "critical"].includes(it.impact));
  return serious.map((it) => `${it.id}: ${it.nodes.map((node) => node.target.join(" ")).join(", ")}`);
}
