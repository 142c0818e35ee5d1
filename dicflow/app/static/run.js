// The screen "run": start, watch, stop and go on; what failed and why; the runs before.

import { Newest, ask } from "./api.js";
import { about, button, empty, fill, h, megabytes } from "./dom.js";
import { expected } from "./settings.js";

export const title = "Run";
const STATES = {
  none: "Not run yet", starting: "Starting", running: "Running", done: "Done", failed: "Ended with failures", stopped: "Stopped", killed: "Ended without a result",
};

export async function show(place, app) {
  if (!app.file) {
    fill(place, empty(title, "There is no pipeline file yet. Begin with the folder: it proposes one.", button("Go to the folder", () => app.go("folder"), { className: "main" })));
    return null;
  }
  const screen = new RunScreen(place, app);
  await screen.open();
  return screen;
}

class RunScreen {
  constructor(place, app) {
    Object.assign(this, { place, app, news: new Newest(), lists: new Newest() });
    this.head = h("div", {});
    this.body = h("div", {});
    this.past = h("div", {});
    fill(place, h("div", { className: "page" }, this.head, this.body, this.past));
  }

  async open() {
    this.state = "";
    await this.look();
    this.list();
  }

  leave() {
    clearTimeout(this.later);
    this.news.drop();
    this.lists.drop();
  }

  /** Ask how the run is going, and again after a while: after three times as long as the answer took, at least. */
  async look() {
    const start = performance.now();
    clearTimeout(this.later);
    try {
      const found = await this.news.of(ask("watch", { file: this.app.file }));
      if (!found) return;
      this.draw(found);
    } catch (error) {
      fill(this.body, h("p", { className: "problem" }, error.message));
    }
    const isBusy = ["running", "starting"].includes(this.state);
    const took = performance.now() - start;
    this.later = setTimeout(() => this.look(), Math.max(isBusy ? 700 : 2500, 3 * took));
  }

  draw(found) {
    const before = this.state;
    this.state = found.state;
    this.app.watched = found;
    if (before && before !== this.state) {
      this.list();
      this.app.plan();
    }
    const isBusy = ["running", "starting"].includes(this.state);
    const plan = this.app.states;
    fill(this.head, h("h1", { className: `state ${this.state}` }, STATES[this.state]),
      h("p", { className: "faint" }, this.words(found)),
      h("div", { className: "row" },
        isBusy ? button("Stop", () => this.act("stop"), { disabled: this.state === "starting" }) : button(this.state === "stopped" || this.state === "killed" ? "Go on" : "Start", () => this.act("start"), { className: "main", disabled: Boolean(this.app.planProblem) }),
        isBusy ? h("span", { className: "faint" }, "The run goes on when this page or the app is closed.") : plan ? h("span", { className: "faint" }, expected(plan)) : this.app.planProblem ? h("span", { className: "problem" }, this.app.planProblem) : null));
    fill(this.body, this.failures(found), this.table(found),
      (found.warnings ?? []).length ? h("div", { className: "card" }, h("h2", {}, "Warnings"), h("ul", {}, found.warnings.map((words) => h("li", {}, words)))) : null);
    if (isBusy || before !== this.state) this.app.redraw?.();
  }

  words(found) {
    if (this.state === "none") return "Start computes what is missing, then writes maps, tables and the report.";
    if (this.state === "starting") return "reading the photographs and making the plan …";
    const since = found.started ? new Date(found.started * 1000).toLocaleString() : "";
    if (this.state === "running") return `since ${since}${found.left_s === null ? "" : `, ${about(found.left_s)} left`}`;
    if (this.state === "killed") return `its last news is of ${new Date(found.last * 1000).toLocaleString()}; what is done is kept, and the next run goes on from there`;
    if (this.state === "stopped") return "finished tasks are kept, and the next run goes on from there";
    return `run ${found.run} of ${since}`;
  }

  /** What failed and why, as the command line says it. */
  failures(found) {
    const failures = found.failures ?? [];
    if (!failures.length && !found.message) return null;
    return h("div", { className: "card bad" }, h("h2", {}, failures.length ? `Failed: ${found.failed}` : "The command ended"),
      found.message ? h("pre", { className: "problem" }, found.message) : null,
      h("ul", {}, failures.map((one) => h("li", { className: "problem" }, one.text))));
  }

  table(found) {
    const stages = Object.entries(found.stages ?? {});
    if (!stages.length) return null;
    return h("div", { className: "card scroll" }, h("table", { className: "progress" },
      h("thead", {}, h("tr", {}, ["stage", "", "done", "stored before", "computed", "failed", "skipped", "seconds"].map((word, k) => h("th", { className: k > 1 ? "number" : "" }, word)))),
      h("tbody", {}, stages.map(([name, row]) => {
        const done = row.hit + row.computed + row.failed + row.skipped;
        return h("tr", { className: row.failed ? "problem" : "" }, h("td", {}, name),
          h("td", { className: "bar" }, h("progress", { max: row.all || 1, value: row.hit + row.computed, "aria-label": `${name} done` })),
          [`${done} of ${row.all}`, row.hit, row.computed, row.failed, row.skipped].map((value) => h("td", { className: "number" }, value === 0 ? "·" : String(value))),
          h("td", { className: "number" }, row.seconds ? row.seconds.toFixed(1) : "·"));
      }))));
  }

  async act(name) {
    try {
      await ask(name, { file: this.app.file });
      this.app.say(name === "start" ? "started" : "stopping; tasks that are under way are finished first");
    } catch (error) {
      await this.app.fail(error);
    }
    await this.look();
  }

  /** The runs before, and what they keep on the disk. */
  async list() {
    try {
      const runs = await this.lists.of(ask("runs", { file: this.app.file }));
      if (!runs) return null;
      const size = h("p", { className: "faint" }, "adding up the files …");
      ask("disk", { file: this.app.file }).then((bytes) => fill(size, `${megabytes(bytes)} on the disk`), () => fill(size));
      if (!runs.length) return fill(this.past);
      return fill(this.past, h("div", { className: "card scroll" }, h("h2", {}, "Runs in this store"), size,
        h("table", { className: "runs" }, h("thead", {}, h("tr", {}, ["run", "pipeline", "started", "computed", "failed", ""].map((word, k) => h("th", { className: k === 3 || k === 4 ? "number" : "" }, word)))),
          h("tbody", {}, runs.map((run) => this.row(run)))), this.cleaning()));
    } catch (error) {
      return fill(this.past, h("p", { className: "problem" }, error.message));
    }
  }

  row(run) {
    const pinned = run.pin !== null && run.pin !== undefined;
    return h("tr", {}, h("td", { className: "id" }, run.id), h("td", {}, run.pipeline), h("td", {}, new Date(run.started * 1000).toLocaleString()),
      h("td", { className: "number" }, String(run.counts.computed ?? "·")), h("td", { className: "number" }, String(run.counts.failed || "·")),
      h("td", { className: "acts" }, h("a", { href: `#compare/${encodeURIComponent(`with=${run.id}`)}`, "aria-label": `Compare run ${run.id}` }, "Compare"), button(pinned ? "Pinned" : "Pin", () => this.pin(run, pinned), { "aria-pressed": String(pinned), title: pinned ? `${run.pin || "kept"}; click takes the pin away` : "keep its products when the store is cleaned up" })));
  }

  async pin(run, pinned) {
    try {
      await ask("pin", { file: this.app.file, run: run.id, note: pinned ? null : "" });
      await this.list();
    } catch (error) {
      await this.app.fail(error);
    }
  }

  cleaning() {
    const keep = h("input", { type: "number", min: 0, required: true, value: "5", "aria-label": "newest runs that keep their products" });
    const answer = h("span", { className: "faint" });
    const newest = new Newest();
    keep.addEventListener("input", () => { newest.drop(); fill(answer); });
    const clean = async (count, isDone) => {
      try {
        const found = await newest.of(ask("clean", { file: this.app.file, keep: count, delete: isDone }));
        if (!found) return;
        const { bytes, products, runs } = found;
        fill(answer, `${isDone ? "freed" : "would free"} ${megabytes(bytes)}: ${products} products, ${runs} runs. `, !isDone && bytes ? button("Delete them", () => clean(count, true)) : null);
        if (isDone) await this.list();
      } catch (error) {
        await this.app.fail(error);
      }
    };
    return h("div", { className: "row" }, "Clean up: keep the newest", keep, "runs of each pipeline, those that are pinned, and what is less than an hour old", button("What would go?", () => keep.reportValidity() && clean(keep.valueAsNumber, false)), answer);
  }
}
