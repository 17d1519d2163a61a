// Requests to the server of this page.

const UNREACHABLE = "The server does not answer. Start `paig studio` again and open the link that it prints; nothing is lost.";

async function answer(response) {
  const isJson = response.headers.get("content-type")?.includes("json");
  const body = isJson ? await response.json() : await response.text();
  if (!response.ok) throw new Error(body.error ?? body ?? response.statusText);
  return body;
}

export async function ask(method, path, body) {
  const options = { method, headers: {} };
  if (body !== undefined) {
    options.body = JSON.stringify(body);
    options.headers["content-type"] = "application/json";
  }
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new Error(UNREACHABLE);
  }
  return answer(response);
}

const of = (name) => `/api/projects/${encodeURIComponent(name)}`;

export const offers = () => ask("GET", "/api/offers");
export const projects = () => ask("GET", "/api/projects");
export const results = () => ask("GET", "/api/results");
export const resultFile = (place, file) => `/api/results/${place.split("/").map(encodeURIComponent).join("/")}/${file}`;
export const project = (name) => ask("GET", of(name));
export const create = (what) => ask("POST", "/api/projects", what);
export const remove = (name) => ask("DELETE", of(name));
export const saveSettings = (name, settings) => ask("PUT", `${of(name)}/settings`, settings);
export const startPreview = (name) => ask("POST", `${of(name)}/preview`);
export const measure = (name) => ask("POST", `${of(name)}/measure`);
export const train = (name, resume) => ask("POST", `${of(name)}/train`, { resume });
export const trainingAddress = (name, number, file) => `${of(name)}/trainings/${number}/${file}`;
export const stop = (name) => ask("POST", `${of(name)}/stop`);
export const frameAddress = (name, frame, created) => `${of(name)}/frames/${frame}?v=${created}`;
export const resultAddress = (name, number, file) => `${of(name)}/measurements/${number}/${file}`;

/// Sends a file; `progress` is called with the share that is sent.
export function upload(name, file, progress) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("PUT", `${of(name)}/source/${encodeURIComponent(file.name)}`);
    request.upload.onprogress = (event) => progress(event.loaded / Math.max(event.total, 1));
    request.onload = () => {
      if (request.status < 300) return resolve();
      let text = request.responseText;
      try {
        text = JSON.parse(text).error;
      } catch {
        // Plain text is shown as it is.
      }
      return reject(new Error(text));
    };
    request.onerror = () => reject(new Error(UNREACHABLE));
    request.send(file);
  });
}
