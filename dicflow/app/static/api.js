// Questions to the server of the app.

/** What the server could not do, in its words. status 409: a file has changed meanwhile. */
export class Refusal extends Error {
  constructor(status, message) {
    super(message);
    this.status = status;
  }
}

/** Ask a question by name and give its answer. Throws Refusal. */
export async function ask(name, asked = {}) {
  let response;
  try {
    response = await fetch(`/ask/${name}`, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(asked),
    });
  } catch {
    throw new Refusal(0, "the app has ended; start it again with 'dicflow app', runs go on meanwhile");
  }
  const answer = await response.json();
  if (!response.ok) throw new Refusal(response.status, answer.message);
  return answer;
}
