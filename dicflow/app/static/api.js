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

/** Answers of one kind, of which only the newest is shown: one that comes after a newer question was asked is dropped. */
export class Newest {
  asked = null;

  /** The answer of a question that was just asked; null if it is not the newest any more. Throws what the newest throws. */
  async of(question) {
    this.asked = question;
    try {
      const answer = await question;
      return this.asked === question ? answer : null;
    } catch (error) {
      if (this.asked === question) throw error;
      return null;
    }
  }

  /** Whatever was asked is of no use any more. */
  drop() {
    this.asked = null;
  }
}

/** A queue: each act begins when those before it have ended, however they ended, and its promise is given. */
export function queue() {
  let last = Promise.resolve();
  return (act) => {
    const own = last.then(act);
    last = own.catch(() => {});
    return own;
  };
}
