// Requests to the server; the token is part of every address, as it is of this file's own.
const base = new URL(".", import.meta.url);

export const address = (path) => new URL(path, base).href;
export const face = (name) => address(`face/${encodeURIComponent(name)}`);

async function asked(path, options) {
  const answer = await fetch(address(path), options);
  if (!answer.ok) {
    const error = new Error((await answer.text()).trim() || answer.statusText);
    error.status = answer.status;
    throw error;
  }
  return answer;
}

export const json = async (path, signal) => (await asked(path, { signal })).json();
export const bytes = async (path) => (await asked(path)).arrayBuffer();
export const picture = async (path, signal) => createImageBitmap(await (await asked(path, { signal })).blob());
// a tile, null where there is none
export async function tile(path) {
  const answer = await asked(path);
  return answer.status === 204 ? null : createImageBitmap(await answer.blob());
}
export const post = async (path, value) => (await asked(path, {
  method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(value),
})).json();
