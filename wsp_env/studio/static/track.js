// Two stops on their track: vehicles roll, wheels turn and tell by their colour how much they slide.
window.wspTrack = (place, stops) => {
  const root = document.getElementById(place);
  if (!root || root.dataset.drawn) return;
  root.dataset.drawn = "yes";
  const SVG = "http://www.w3.org/2000/svg", WIDTH = 1000, HEIGHT = 128, RAIL = 96, NOSE = 940;
  const make = (name, attributes, parent, text) => {
    const made = document.createElementNS(SVG, name);
    for (const key in attributes) made.setAttribute(key, attributes[key]);
    if (text !== undefined) made.textContent = text;
    parent.appendChild(made);
    return made;
  };
  const longest = Math.max(...stops.map(stop => stop.time_s)), farthest = Math.max(...stops.map(stop => stop.distance_m));

  function angles(stop) {
    const t = stop.course.time_s, turned = stop.course.wheel_mps.map(row => row.map(() => 0));
    for (let i = 1; i < t.length; i++)
      for (let k = 0; k < turned[i].length; k++)
        turned[i][k] = turned[i - 1][k] + (t[i] - t[i - 1]) * (stop.course.wheel_mps[i][k] + stop.course.wheel_mps[i - 1][k]) / 2
          / stop.vehicle.radius_m;
    return turned;
  }
  function at(stop, time) {  // sample before, and the share of the way to the next
    const t = stop.course.time_s;
    let low = 0, high = t.length - 1;
    if (time >= t[high]) return [high - 1, 1];
    while (high - low > 1) { const middle = (low + high) >> 1; if (t[middle] <= time) low = middle; else high = middle; }
    return [low, (time - t[low]) / Math.max(t[high] - t[low], 1e-9)];
  }
  const between = (values, [i, share], k) => {
    const a = k === undefined ? values[i] : values[i][k], b = k === undefined ? values[i + 1] : values[i + 1][k];
    return a + share * (b - a);
  };
  const colour = (slip, speed) => {
    const creepage = Math.abs(slip) / Math.max(speed, 1);
    return creepage < 0.03 ? "#009E73" : creepage < 0.3 ? "#E69F00" : "#D55E00";
  };

  function lane(stop, name) {
    const axles = stop.vehicle.axle_positions_m, span = axles[axles.length - 1] + 6;
    const scale = Math.min(30, 860 / span), wheel = Math.max(4, Math.min(15, 1.3 * stop.vehicle.radius_m * scale));
    const x = position => NOSE - 3 * scale - position * scale;
    const picture = make("svg", {viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `stop ${name} on its track`,
      style: "width: 100%; display: block"}, root);
    const ground = make("g", {}, picture);
    make("line", {x1: 0, x2: WIDTH, y1: RAIL, y2: RAIL, stroke: "#52606d", "stroke-width": 3}, picture);
    let axle = 0;
    for (const body of stop.vehicle.bodies) {
      const count = body.reduce((sum, bogie) => sum + bogie, 0), from = x(axles[axle]), to = x(axles[axle + count - 1]);
      make("rect", {x: to - 2.2 * scale, y: RAIL - wheel * 2 - 42, width: from - to + 4.4 * scale, height: 34, rx: 6, fill: "#dfe7ee",
        stroke: "#9aa5b1"}, picture);
      for (const bogie of body) {
        const ends = [x(axles[axle]), x(axles[axle + bogie - 1])];
        make("line", {x1: ends[0] + 6, x2: ends[1] - 6, y1: RAIL - wheel, y2: RAIL - wheel, stroke: "#52606d", "stroke-width": 4,
          "stroke-linecap": "round"}, picture);
        axle += bogie;
      }
    }
    const wheels = axles.map(position => {
      const group = make("g", {transform: `translate(${x(position)} ${RAIL - wheel})`}, picture);
      const disc = make("circle", {r: wheel, fill: "#009E73", stroke: "#1f2933", "stroke-width": 1.2}, group);
      const spoke = make("path", {d: `M 0 ${-wheel} V ${wheel} M ${-wheel} 0 H ${wheel}`, stroke: "white", "stroke-width": 1.4}, group);
      const height = 26;
      make("rect", {x: -3, y: -wheel - 12 - height, width: 6, height, fill: "white", stroke: "#9aa5b1", "stroke-width": .6}, group);
      const bar = make("rect", {x: -3, width: 6, fill: "#0072B2"}, group);
      return {disc, spoke, bar, foot: -wheel - 12, height};
    });
    make("text", {x: 10, y: 22, "font-size": 17, "font-weight": 700, fill: "#1f2933"}, picture, name);
    const says = make("text", {x: 36, y: 22, "font-size": 14, fill: "#52606d"}, picture);
    const turned = angles(stop);
    return time => {
      const now = at(stop, time), c = stop.course, speed = between(c.speed_mps, now), place = between(c.position_m, now);
      const slip = Math.max(...axles.map((_, k) => Math.abs(between(c.slip_speed_mps, now, k))));
      says.textContent = `${(3.6 * speed).toFixed(0)} km/h · ${place.toFixed(0)} m · largest slip ${(3.6 * slip).toFixed(0)} km/h`
        + (time >= stop.time_s ? (stop.stopped ? " · stands" : " · given up") : "");
      ground.replaceChildren();
      const first = Math.ceil((place - NOSE / scale) / 10) * 10;
      for (let metre = Math.max(first, 0); x(0) + (metre - place) * scale < WIDTH; metre += 10) {
        const here = x(0) + (metre - place) * scale, long = metre % 50 === 0;
        make("line", {x1: here, x2: here, y1: RAIL, y2: RAIL + (long ? 10 : 5), stroke: "#9aa5b1"}, ground);
        if (here > 24 && here < WIDTH - 24) make("text", {x: here, y: RAIL + 24, "font-size": 11, "text-anchor": "middle", fill: long ? "#52606d" : "#9aa5b1"}, ground, `${metre} m`);
      }
      wheels.forEach((one, k) => {
        one.disc.setAttribute("fill", colour(between(c.slip_speed_mps, now, k), speed));
        one.spoke.setAttribute("transform", `rotate(${between(turned, now, k) * 180 / Math.PI})`);
        const full = Math.min(between(c.pressure_bar, now, k) / stop.vehicle.full_pressure_bar, 1) * one.height;
        one.bar.setAttribute("y", one.foot - full);
        one.bar.setAttribute("height", Math.max(full, 0));
      });
    };
  }

  function overview() {
    const picture = make("svg", {viewBox: `0 0 ${WIDTH} 40`, style: "width: 100%; display: block", "aria-hidden": "true"}, root);
    const x = metres => 20 + 960 * metres / Math.max(farthest, 1);
    make("line", {x1: 20, x2: 980, y1: 16, y2: 16, stroke: "#c5ccd3", "stroke-width": 3}, picture);
    const marks = stops.map((stop, number) => {
      const name = "AB"[number], end = x(stop.distance_m);
      make("line", {x1: end, x2: end, y1: 8, y2: 24, stroke: "#52606d"}, picture);
      make("text", {x: end, y: 37, "font-size": 11, "text-anchor": end > 940 ? "end" : "middle", fill: "#52606d"}, picture,
        `${name} ${stop.distance_m.toFixed(0)} m`);
      return make("text", {y: number ? 30 : 11, "font-size": 12, "font-weight": 700, "text-anchor": "middle", fill: "#0072B2"}, picture, name);
    });
    return time => stops.forEach((stop, number) =>
      marks[number].setAttribute("x", x(between(stop.course.position_m, at(stop, time)))));
  }

  const draws = [...stops.map((stop, number) => lane(stop, "AB"[number])), overview()];
  const row = document.createElement("div");
  row.style = "display: flex; gap: .8rem; align-items: center";
  const play = Object.assign(document.createElement("button"), {textContent: "▶ Watch", type: "button", className: "track-play"});
  const slider = Object.assign(document.createElement("input"), {type: "range", min: 0, max: longest, step: 0.05, value: 0.3 * longest});
  slider.setAttribute("aria-label", "time of the stop in seconds");
  slider.style.flex = "1";
  const clock = document.createElement("span");
  clock.style = "font-variant-numeric: tabular-nums; width: 4.5rem; text-align: right";
  const pace = document.createElement("select");
  pace.setAttribute("aria-label", "pace");
  for (const [value, words] of [[1, "as it is"], [4, "4 times"], [10, "10 times"]]) pace.add(new Option(words, value, value === 4, value === 4));
  row.append(play, slider, clock, pace);
  root.append(row);
  const show = time => { draws.forEach(draw => draw(time)); clock.textContent = `${time.toFixed(1)} s`; };
  let running = false, last = 0;
  function frame(now) {
    if (!running || !root.isConnected) return;
    let time = Number(slider.value) + Math.min(now - last, 100) / 1000 * Number(pace.value);
    last = now;
    if (time >= longest) { time = longest; halt(); }
    slider.value = time;
    show(time);
    requestAnimationFrame(frame);
  }
  function halt() { running = false; play.textContent = "▶ Watch"; }
  play.onclick = () => {
    if (running) { halt(); return; }
    if (Number(slider.value) >= longest) slider.value = 0;
    running = true;
    play.textContent = "❚❚ Pause";
    last = performance.now();
    requestAnimationFrame(frame);
  };
  slider.oninput = () => show(Number(slider.value));
  show(Number(slider.value));
};
