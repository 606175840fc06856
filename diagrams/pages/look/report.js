"use strict";
(function () {
  const data = JSON.parse(document.getElementById("numbers").textContent);
  const at = (id) => document.getElementById(id);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  let printing = false;
  const redraws = [];
  const drawn = new Set();
  const waiting = [];

  // one after the other, each when the browser has nothing else to do: the first is seen before the second is begun
  const rest = window.requestIdleCallback || ((work) => setTimeout(work, 1));
  const next = () => {
    const redraw = waiting.shift();
    if (redraw && !drawn.has(redraw)) {
      drawn.add(redraw);
      redraw();
      if (!document.documentElement.dataset.drawn) document.documentElement.dataset.drawn = String(Math.round(performance.now()));
    }
    if (waiting.length) rest(next, { timeout: 500 });
  };

  // a plot is drawn when it comes near the window: the page is there at once, however many it has
  const lazily = (section, redraw) => {
    redraws.push(() => { if (drawn.has(redraw) || printing) { drawn.add(redraw); redraw(); } });
    new IntersectionObserver((entries, observer) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      observer.disconnect();
      waiting.push(redraw);
      if (waiting.length === 1) rest(next, { timeout: 100 });
    }, { rootMargin: "300px" }).observe(at(section));
  };

  // -------------------------------------------------------------------------------------------- what needs no curves

  const contents = at("contents");
  document.querySelectorAll("main > section").forEach((section) => {
    const link = document.createElement("a");
    link.href = "#" + section.id;
    link.textContent = section.querySelector("h2").textContent;
    contents.append(link);
  });

  document.querySelectorAll(".copy").forEach((button) => {
    button.addEventListener("click", async () => {
      const code = button.previousElementSibling;
      try {
        await navigator.clipboard.writeText(code.textContent);
        button.textContent = "Copied";
      } catch {
        getSelection().selectAllChildren(code);
        button.textContent = "Selected";
      }
      setTimeout(() => (button.textContent = "Copy"), 1500);
    });
  });

  if (at("scenario-find")) {
    const lines = [...document.querySelectorAll("#scenario-lines .line")];
    at("scenario-find").addEventListener("input", (event) => {
      const wanted = event.target.value.trim().toLowerCase();
      lines.forEach((line) => {
        const hit = wanted !== "" && line.textContent.toLowerCase().includes(wanted);
        line.classList.toggle("hit", hit);
        line.classList.toggle("hidden", wanted !== "" && !hit);
      });
    });
  }

  if (at("diagram-box")) {
    const svg = at("diagram-svg");
    let zoom = 100;
    const scale = (to) => {
      zoom = Math.min(800, Math.max(25, to));
      svg.style.width = zoom + "%";
    };
    at("diagram-in").addEventListener("click", () => scale(zoom * 1.4));
    at("diagram-out").addEventListener("click", () => scale(zoom / 1.4));
    at("diagram-fit").addEventListener("click", () => scale(100));
    at("diagram-find").addEventListener("input", (event) => {
      const wanted = event.target.value.trim().toLowerCase();
      svg.querySelectorAll(".hit").forEach((old) => old.classList.remove("hit"));
      let first = null;
      let count = 0;
      svg.querySelectorAll(".node text").forEach((text) => {
        if (wanted === "" || !text.textContent.toLowerCase().includes(wanted)) return;
        text.classList.add("hit");
        text.closest(".node").classList.add("hit");
        first = first || text;
        count += 1;
      });
      at("diagram-found").textContent = wanted === "" ? "" : count + " found";
      if (first) first.scrollIntoView({ block: "nearest", inline: "nearest" });
    });
  }

  // ---------------------------------------------------------------------------------------------------- the curves

  const look = () => {
    const style = getComputedStyle(document.documentElement);
    const of = (name) => style.getPropertyValue(name).trim();
    return { ink: of("--ink"), soft: of("--soft"), line: of("--line"), paper: of("--paper") };
  };

  // black lines on a dark page would not be seen
  const shade = (color) => (dark.matches && !printing && color === "#000000" ? "#ffffff" : color);

  const axis = (title, more) => {
    const { ink, line } = look();
    return Object.assign(
      { title: { text: title }, color: ink, gridcolor: line, zerolinecolor: line, automargin: true, exponentformat: "power" },
      more
    );
  };

  // few ticks, and whole numbers at them: with more of them Plotly writes bare digits, a 5 for 500
  const log = (on) => (on ? { type: "log", dtick: undefined, nticks: 4, tickformat: "~g" } : { type: "linear" });

  const draw = (id, traces, layout) => {
    const { ink, paper } = look();
    const narrow = innerWidth < 700;
    const whole = Object.assign(
      {
        paper_bgcolor: paper,
        plot_bgcolor: paper,
        font: { color: ink, size: 13 },
        margin: { l: 60, r: 16, t: layout.title ? 44 : 34, b: 48 },
        legend: narrow ? { orientation: "h", y: -0.25 } : {},
        hoverlabel: { namelength: -1 },
      },
      layout
    );
    return Plotly.react(id, traces, whole, {
      responsive: true,
      displaylogo: false,
      ...(narrow ? { displayModeBar: false } : {}), // it would hide the title
      modeBarButtonsToRemove: ["select2d", "lasso2d"],
      toImageButtonOptions: { format: "svg", filename: id },
    });
  };

  const same = (a, b) => a.every((x, i) => x === b[i] || (x && b[i] && Math.abs(x / b[i] - 1) < 1e-6));

  function errors() {
    const { curves, estimators } = data;
    const chosen = curves.quantities[at("quantity").selectedIndex] || curves.quantities[0];
    if (!chosen) return;
    const traces = [];
    estimators.forEach(({ name, color, dash }) => {
      const line = { color: shade(color), dash, width: 2.2 };
      const group = { legendgroup: name, x: curves.time, mode: "lines" };
      const markers = curves.time.length === 1 ? { mode: "markers" } : {};
      traces.push({ ...group, ...markers, name, y: chosen.rmse[name], line });
      if (at("error-median").checked && chosen.median) {
        traces.push({ ...group, ...markers, name: name + ", median", y: chosen.median[name], line: { ...line, width: 1.2 } });
      }
      if (!at("error-bounds").checked) return;
      const bound = chosen.bound[name] || [];
      const of_truth = chosen.bound_truth[name] || [];
      if (bound.some((v) => v !== null)) {
        traces.push({ ...group, ...markers, name: name + ", bound", y: bound, line: { color: line.color, dash: "dot", width: 2 } });
      }
      if (of_truth.some((v) => v !== null) && !same(of_truth, bound)) {
        const thin = { color: line.color, dash: "dot", width: 1 };
        traces.push({ ...group, ...markers, name: name + ", bound of the true motion", y: of_truth, line: thin });
      }
    });
    draw("error-plot", traces, {
      hovermode: "x unified",
      xaxis: axis(curves.axis),
      yaxis: axis("RMSE, " + chosen.name + " [" + chosen.unit + "]", log(at("error-log").checked)),
    });
  }

  function consistency() {
    const { curves, estimators } = data;
    const kind = at("consistency-kind").value;
    const found = curves[kind];
    const traces = [];
    let drawn = "";
    estimators.forEach(({ name, color, dash }) => {
      const row = found[name];
      if (kind === "nees" && row.lower !== null && drawn !== row.lower + " " + row.upper) {
        drawn = row.lower + " " + row.upper;
        const ends = [curves.time[0], curves.time[curves.time.length - 1]];
        traces.push({
          x: [...ends, ...[...ends].reverse()], y: [row.lower, row.lower, row.upper, row.upper], fill: "toself",
          fillcolor: "rgba(128,128,128,.25)", line: { width: 0 }, mode: "lines", name: "95 % band, " + row.freedom + " components",
          hoverinfo: "skip",
        });
      }
      traces.push({ x: curves.time, y: row.mean, name, mode: "lines", line: { color: shade(color), dash, width: 2 } });
    });
    const label = kind === "nees" ? "mean NEES / components" : "mean NIS / rows";
    draw("consistency-plot", traces, {
      hovermode: "x unified",
      xaxis: axis(curves.axis),
      yaxis: axis(label, { ...log(at("consistency-log").checked), ...(at("consistency-log").checked ? {} : { rangemode: "tozero" }) }),
    });
  }

  // the names of platforms that start so close together that theirs would lie on each other stand at the first of them
  const named_together = (view) => {
    const platforms = view.tracks.filter((track) => track.kind !== "target" && track.x[0] !== null);
    const reach = ["x", "y"].map((key, k) => {
      if (view.shown) return 0.08 * Math.abs(view.shown[k][1] - view.shown[k][0]);
      const all = view.tracks.flatMap((track) => track[key]).filter((v) => v !== null);
      return 0.08 * (all.reduce((a, b) => Math.max(a, b), -Infinity) - all.reduce((a, b) => Math.min(a, b), Infinity));
    });
    const groups = [];
    platforms.forEach((track) => {
      const near = groups.find(
        ([first]) => Math.abs(first.x[0] - track.x[0]) <= 1.6 * reach[0] && Math.abs(first.y[0] - track.y[0]) <= reach[1]
      );
      if (near) near.push(track);
      else groups.push([track]);
    });
    const few = (names) => names.slice(0, 3).join(", ") + (names.length > 3 ? " + " + (names.length - 3) : "");
    return new Map(groups.map((group) => [group[0], few(group.map((track) => track.name))]));
  };

  function views() {
    data.views.forEach((view, i) => {
      const seen = new Set();
      const traces = [];
      const sides = ["top center", "bottom center", "middle right", "middle left"];
      const labels = named_together(view);
      let places = -1;
      if (view.coast && view.coast.x.length) {
        traces.push({
          x: view.coast.x, y: view.coast.y, mode: "lines", name: "coast", hoverinfo: "skip", line: { color: "rgba(128,128,128,.8)", width: 1 },
        });
      }
      view.tracks.forEach((track) => {
        const target = track.kind === "target";
        const color = target ? "#d55e00" : look().soft;
        const group = target ? "target" : "platforms";
        const shared = { legendgroup: group, text: track.name, hovertemplate: "%{text}<br>%{x}, %{y}<extra></extra>" };
        traces.push({
          ...shared, x: track.x, y: track.y, mode: "lines", name: group, showlegend: !seen.has(group),
          line: { color, width: target ? 2.5 : 1.5 },
        });
        const label = labels.get(track);
        const side = label === undefined || label === track.name ? sides[(places += label ? 1 : 0) % sides.length] : "bottom right";
        traces.push({
          ...shared, x: track.x.slice(0, 1), y: track.y.slice(0, 1), mode: label ? "markers+text" : "markers", text: label || track.name,
          hovertemplate: track.name + "<br>%{x}, %{y}<extra></extra>", textposition: side, textfont: { size: 11 }, showlegend: false,
          marker: { color, size: 8 }, name: track.name,
        });
        seen.add(group);
      });
      const tied = view.stretch === null ? {} : { scaleanchor: "x", scaleratio: view.stretch };
      draw("view-" + i, traces, {
        title: { text: view.title, font: { size: 14 } },
        xaxis: axis(view.x, view.shown ? { range: view.shown[0] } : {}),
        yaxis: axis(view.y, { ...tied, ...(view.shown ? { range: view.shown[1] } : {}) }),
        legend: { orientation: "h", y: -0.2 },
        hovermode: "closest",
      });
    });
  }

  let all_ends = false;
  function ends() {
    const { last, estimators } = data;
    const traces = estimators.map(({ name, color, symbol }) => ({
      x: last.clouds[name].x, y: last.clouds[name].y, text: last.trials.map((n) => "trial " + n), name, mode: "markers",
      hovertemplate: "%{text}<br>%{x}, %{y} m", marker: { color: shade(color), symbol, size: 6, opacity: 0.75 },
    }));
    traces.push({ x: [0], y: [0], name: "truth", mode: "markers", marker: { symbol: "cross-thin", size: 16, line: { width: 2, color: look().ink } } });
    const range = last.edge === null || all_ends ? {} : { range: [-last.edge, last.edge] };
    draw("ends-plot", traces, { xaxis: axis(last.x, range), yaxis: axis(last.y, { ...range, scaleanchor: "x" }), hovermode: "closest" });
    at("ends-all").setAttribute("aria-pressed", String(last.edge === null || all_ends));
    at("ends-near").setAttribute("aria-pressed", String(last.edge !== null && !all_ends));
    at("ends-note").textContent =
      "Estimate minus truth at " + last.time + " s, one dot per trial. " +
      (last.edge === null ? "" : last.beyond + " dots lie beyond the edge. ") +
      (last.left_out ? last.left_out + " trials are left out." : "");
  }

  // --------------------------------------------------------------------------------------------------- single trials

  let numbers = null;
  let shown = null;
  function column(estimator, trial, name) {
    const { courses } = data;
    const width = courses.columns.length;
    const steps = courses.time.length;
    const begin = (estimator * courses.trials.length + trial) * steps * width + courses.columns.indexOf(name);
    return courses.time.map((_, k) => {
      const value = numbers[begin + k * width];
      return Number.isFinite(value) ? value : null;
    });
  }

  function ellipse(x, y, a, b, c) {
    // 95 % of a plane normal distribution: 5.991 = chi-square of two degrees of freedom
    const middle = (a + c) / 2;
    const half = Math.hypot((a - c) / 2, b);
    const turn = 0.5 * Math.atan2(2 * b, a - c);
    const [major, minor] = [middle + half, middle - half].map((v) => Math.sqrt(5.991 * Math.max(v, 0)));
    const points = [];
    for (let i = 0; i <= 48; i += 1) {
      const [u, v] = [major * Math.cos((i * Math.PI) / 24), minor * Math.sin((i * Math.PI) / 24)];
      points.push([x + u * Math.cos(turn) - v * Math.sin(turn), y + u * Math.sin(turn) + v * Math.cos(turn)]);
    }
    return points;
  }

  function trial() {
    const { courses, estimators } = data;
    const e = at("trial-estimator").selectedIndex;
    const name = estimators[e].name;
    const t = courses.trials.indexOf(shown);
    if (t < 0) {
      at("trial-note").textContent =
        "Trial " + shown + " is not on this page; it has " + courses.trials.length + " trials: " + courses.trials.slice(0, 8).join(", ") +
        (courses.trials.length > 8 ? " ... " + courses.trials[courses.trials.length - 1] : "") + ".";
      return;
    }
    const color = shade(estimators[e].color);
    const picks = Object.entries(courses.picks[name] || {}).filter((pick) => pick[1] === shown).map((pick) => pick[0]);
    const final = courses.final[e][t];
    at("trial-note").textContent =
      name + ", trial " + shown + (picks.length ? " (" + picks.join(", ") + " at the end)" : "") + ": position error at the end " +
      (final === null ? "infinite or unknown" : Number(final.toPrecision(4)) + " m") + ".";
    ["worst", "median", "best"].forEach((what) => at("trial-" + what).setAttribute("aria-pressed", String(picks.includes(what))));
    const [first, second, third] = courses.axes.map((axis_name) => column(e, t, axis_name));
    const ground = [
      { x: first, y: second, mode: "lines+markers", marker: { size: 4 }, line: { color, width: 1.5 }, name: "estimate minus truth",
        text: courses.time.map((s) => s + " s"), hovertemplate: "%{text}<br>%{x}, %{y} m<extra></extra>" },
      { x: [0], y: [0], mode: "markers", marker: { symbol: "cross-thin", size: 16, line: { width: 2, color: look().ink } }, name: "truth" },
    ];
    const sizes = first.map((_, k) => {
      const parts = [first[k], second[k], third ? third[k] : 0];
      return parts.includes(null) ? null : Math.hypot(...parts);
    });
    const error = [{ x: courses.time, y: sizes, mode: "lines", line: { color, width: 2 }, name: "position error" }];
    if (courses.covariance) {
      const [a, b, c] = ["c00", "c01", "c11"].map((term) => column(e, t, term));
      const up = courses.columns.includes("c22") ? column(e, t, "c22") : a.map(() => 0);
      const steps = Math.max(1, Math.floor(courses.time.length / 8));
      const xs = [];
      const ys = [];
      for (let k = courses.time.length - 1; k >= 0; k -= steps) {
        if (first[k] === null || a[k] === null) continue;
        ellipse(first[k], second[k], a[k], b[k], c[k]).forEach(([x, y]) => { xs.push(x); ys.push(y); });
        xs.push(null);
        ys.push(null);
      }
      ground.push({ x: xs, y: ys, mode: "lines", line: { color, width: 1, dash: "dot" }, name: "95 % ellipses", hoverinfo: "skip" });
      const claimed = a.map((v, k) => (v === null || up[k] === null ? null : Math.sqrt(Math.max(0, v + c[k] + up[k]))));
      error.push({ x: courses.time, y: claimed, mode: "lines", line: { color, width: 1.5, dash: "dot" }, name: "claimed (1 sigma)" });
    }
    draw("trial-ground", ground, {
      xaxis: axis(courses.axes[0] + " [m]"), yaxis: axis(courses.axes[1] + " [m]", { scaleanchor: "x" }),
      legend: { orientation: "h", y: -0.2 }, hovermode: "closest",
    });
    draw("trial-error", error, { xaxis: axis(data.curves.axis), yaxis: axis("position error [m]", log(true)), legend: { orientation: "h", y: -0.2 } });
    const freedom = data.curves.nees[name].freedom;
    const residuals = [
      { x: courses.time, y: column(e, t, "nees").map((v) => (v === null ? null : v / freedom)), name: "NEES per component", mode: "lines", line: { color, width: 2 } },
      { x: courses.time, y: column(e, t, "nis"), name: "NIS per row", mode: "lines", line: { color, width: 1.2, dash: "dot" } },
    ];
    draw("trial-residuals", residuals, { xaxis: axis(data.curves.axis), yaxis: axis("NEES, NIS", { rangemode: "tozero" }), legend: { orientation: "h", y: -0.5 } });
  }

  function start_trials() {
    const { courses, estimators } = data;
    const bytes = Uint8Array.from(atob(courses.data), (c) => c.charCodeAt(0));
    numbers = new Float32Array(bytes.buffer);
    estimators.forEach(({ name }) => at("trial-estimator").append(new Option(name)));
    const name = () => estimators[at("trial-estimator").selectedIndex].name;
    const show = (number) => {
      shown = number;
      at("trial-number").value = number;
      trial();
    };
    ["worst", "median", "best"].forEach((what) =>
      at("trial-" + what).addEventListener("click", () => {
        const pick = courses.picks[name()][what];
        if (pick === undefined) at("trial-note").textContent = name() + " has no trial with a known error.";
        else show(pick);
      })
    );
    at("trial-estimator").addEventListener("change", trial);
    at("trial-number").addEventListener("input", (event) => {
      if (event.target.value !== "") {
        shown = Number(event.target.value);
        trial();
      }
    });
    const pick = courses.picks[estimators[0].name];
    shown = pick.median === undefined ? courses.trials[0] : pick.median;
    at("trial-number").value = shown;
  }

  // ------------------------------------------------------------------------------------------ sweeps and requirements

  function sweep() {
    const { sweep: found, estimators } = data;
    const what = at("sweep-what").value;
    const traces = [];
    estimators.forEach(({ name, color, dash }) => {
      const row = found.rows[name];
      const line = { color: shade(color), dash, width: 2 };
      const y = row[what].map((one) => one.value);
      traces.push({
        x: found.values, y, name, mode: "lines+markers", line, legendgroup: name,
        error_y: {
          type: "data", symmetric: false, array: row[what].map((one, i) => (one.high === null ? 0 : one.high - y[i])),
          arrayminus: row[what].map((one, i) => (one.low === null ? 0 : y[i] - one.low)), color: line.color,
        },
      });
      if (what === "rmse_position_m" && row.bound_position_m) {
        traces.push({ x: found.values, y: row.bound_position_m, name: name + ", bound", mode: "lines", line: { ...line, dash: "dot", width: 1.5 }, legendgroup: name });
      }
    });
    const label = at("sweep-what").selectedOptions[0].textContent;
    const positive = found.values.every((v) => v > 0) && found.values.length > 2;
    draw("sweep-plot", traces, {
      hovermode: "x unified", xaxis: axis(found.key, positive && at("sweep-log").checked ? { type: "log" } : {}),
      yaxis: axis(label, log(at("sweep-log").checked)),
    });
  }

  function requirements() {
    const rows = data.requirements;
    const over = (one, value) => {
      const limit = one.at_most === null ? one.at_least : one.at_most;
      return value === null || !limit ? null : value / limit;
    };
    const names = rows.map((one, i) => i + 1 + ". " + one.name);
    const colors = { holds: "#147a3c", fails: "#b42318" };
    const traces = [
      {
        x: rows.map((one) => over(one, one.estimate)), y: names, mode: "markers", text: rows.map((one) => one.verdict), name: "estimate / limit",
        marker: { size: 10, color: rows.map((one) => colors[one.verdict] || "#b98900") }, hovertemplate: "%{y}<br>%{x} of the limit, %{text}<extra></extra>",
        error_x: {
          type: "data", symmetric: false, array: rows.map((one) => Math.max(0, over(one, one.upper) - over(one, one.estimate))),
          arrayminus: rows.map((one) => Math.max(0, over(one, one.estimate) - over(one, one.lower))),
        },
      },
    ];
    at("requirements-plot").style.height = 120 + 34 * rows.length + "px";
    draw("requirements-plot", traces, {
      xaxis: axis("estimate over limit"), yaxis: axis("", { autorange: "reversed" }),
      shapes: [{ type: "line", x0: 1, x1: 1, yref: "paper", y0: 0, y1: 1, line: { color: look().soft, dash: "dash" } }],
    });
  }

  // -------------------------------------------------------------------------------------------------------- beginning

  function begin() {
    const on = (id, redraw) => at(id).addEventListener("change", redraw);
    if (data.curves) {
      data.curves.quantities.forEach((one) => at("quantity").append(new Option(one.name + " [" + one.unit + "]")));
      ["quantity", "error-log", "error-bounds", "error-median"].forEach((id) => on(id, errors));
      ["consistency-kind", "consistency-log"].forEach((id) => on(id, consistency));
      lazily("errors", errors);
      lazily("consistency", consistency);
    }
    if (data.views && data.views.length) {
      data.views.forEach((_, i) => {
        const box = document.createElement("div");
        box.id = "view-" + i;
        box.className = "plot square";
        at("views").append(box);
      });
      lazily("geometry", views);
    }
    if (data.last) {
      at("ends-all").addEventListener("click", () => { all_ends = true; ends(); });
      at("ends-near").addEventListener("click", () => { all_ends = false; ends(); });
      lazily("ends", ends);
    }
    if (data.courses) {
      start_trials();
      lazily("trial", trial);
    }
    if (data.sweep) {
      ["sweep-what", "sweep-log"].forEach((id) => on(id, sweep));
      lazily("sweep", sweep);
    }
    if (data.requirements) lazily("requirements", requirements);
    const all = () => redraws.forEach((redraw) => redraw());
    dark.addEventListener("change", all);
    addEventListener("beforeprint", () => { printing = true; all(); });
    addEventListener("afterprint", () => { printing = false; all(); });
    document.documentElement.dataset.ready = "yes";
  }

  async function unpack() {
    const packed = Uint8Array.from(atob(at("plotly").textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
  }

  unpack().then(begin).catch((error) => {
    document.documentElement.dataset.ready = "failed";
    document.querySelectorAll(".plot").forEach((plot) => (plot.textContent = "This browser cannot draw the curves: " + error));
    console.error(error);
  });
})();
