'use strict';
(() => {
  const $$ = (selector, of = document) => [...of.querySelectorAll(selector)];
  const status = document.getElementById('status');
  let clear = 0;
  const say = (text) => {
    status.textContent = text;
    clearTimeout(clear);
    clear = setTimeout(() => { status.textContent = ''; }, 2500);
  };
  const element = (name, attributes = {}, ...children) => {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  };

  // What the page carries compressed, each inflated once.
  const parsedPage = new Promise((resolve) => {
    if (document.readyState === 'loading') document.addEventListener('DOMContentLoaded', resolve);
    else resolve();
  });
  const inflated = new Map();
  const inflate = async (id) => {
    await parsedPage;
    const bytes = Uint8Array.from(atob(document.getElementById(id).textContent.trim()), (c) => c.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'))).text();
  };
  const packed = (id) => {
    if (!inflated.has(id)) inflated.set(id, inflate(id));
    return inflated.get(id);
  };
  const parsed = new Map();
  const data = (id) => {
    if (!parsed.has(id)) parsed.set(id, packed(id).then(JSON.parse));
    return parsed.get(id);
  };

  // Colours.
  const root = document.documentElement;
  const dark = matchMedia('(prefers-color-scheme: dark)');
  const remembered = () => { try { return localStorage.getItem('mcl-eval-theme'); } catch { return null; } };
  let theme = remembered() ?? 'auto';
  const themed = () => (theme === 'auto' ? (dark.matches ? 'dark' : 'light') : theme);
  const applyTheme = (shown = themed()) => {
    root.dataset.theme = shown;
    document.querySelector('[data-do="theme"] b').textContent = theme;
    for (const plot of $$('.plot.drawn')) recolour(plot);
    document.dispatchEvent(new CustomEvent('themechange', { detail: shown }));
  };

  // Numbers as in the rest of the program: at least two significant digits, a minus sign that is one.
  const decimalsOf = (size) => (size >= 100 ? 0 : size >= 1 ? 2 : size >= 0.01 ? 3 : size >= 1e-4 ? 5 : -1);
  const number = (value) => {
    const size = Math.abs(value);
    if (Number.isInteger(value) && size < 1e7) return String(value).replace('-', '−');
    const decimals = decimalsOf(size);
    return (decimals < 0 ? value.toExponential(1) : value.toFixed(decimals)).replaceAll('-', '−');
  };
  // A mean and its interval, with the same decimals: two digits of the interval's width at least.
  const measured = (value, low = null, high = null) => {
    if (low === null || high === null || low === high) return [number(value), null];
    const largest = Math.max(...[value, low, high].map(Math.abs));
    const decimals = Math.max(decimalsOf(largest), 1 - Math.floor(Math.log10(high - low)));
    const shown = [value, low, high].map((each) => (largest < 1e-4 || decimals > 9 ? number(each) : each.toFixed(decimals).replace('-', '−')));
    return [shown[0], `${shown[1]} to ${shown[2]}`];
  };
  const counted = (count, what) => `${count} ${what}${count === 1 ? '' : 's'}`;
  // plotly takes some markup in labels; names are none.
  const plain = (text) => text.replaceAll('&', '&amp;').replaceAll('<', '&lt;').replaceAll('>', '&gt;');

  // Scales: 'linear', 'places', 'log', or the magnitude below which a logarithm of both signs is linear. plotly has no
  // such scale: values are laid out here, and ticks named.
  const SYMLOG = { symlog: 1, 'symlog-fine': 0.1 };
  const isLog = (scale) => scale !== 'linear' && scale !== 'places';
  const smallest = (values) => Math.min(...values.map(Math.abs).filter((size) => size > 0));
  const logOf = (scale, values) => {
    if (isLog(scale)) return SYMLOG[scale] ?? scale;
    return values.every((value) => value > 0) ? 'log' : 10 ** Math.floor(Math.log10(Math.min(smallest(values), 1)));
  };
  // The scale of an axis: its own (null), or a logarithm or none as its button asks.
  const scaleOf = (axis, asked, values) => (asked ?? isLog(axis.scale) ? logOf(axis.scale, values) : asked === null ? axis.scale : 'linear');
  // What plotly takes for a value; places along an axis, which are exponents on its logarithmic ones; and back.
  const laidOut = (scale, value) => {
    if (typeof scale !== 'number') return value;
    return Math.abs(value) <= scale ? value / scale : Math.sign(value) * (1 + Math.log10(Math.abs(value) / scale));
  };
  const along = (scale, value) => (scale === 'log' ? Math.log10(value) : laidOut(scale, value));
  const valueAt = (scale, place) => {
    if (scale === 'log') return 10 ** place;
    return Math.abs(place) <= 1 ? place * scale : Math.sign(place) * scale * 10 ** (Math.abs(place) - 1);
  };
  const rangeOf = (scale, values) => {
    const places = (scale === 'log' ? values.filter((value) => value > 0) : values).map((value) => along(scale, value));
    const [low, high] = [Math.min(...places), Math.max(...places)];
    if (!(low <= high)) return [0, 1];
    const room = 0.06 * (high - low) || 0.1 * Math.abs(low) || 0.5;
    return [low - room, high + room];
  };
  const tickText = (value) => (value !== 0 && (Math.abs(value) < 1e-4 || Math.abs(value) >= 1e6) ? value.toExponential() : String(value)).replaceAll('-', '−');
  // Round numbers of every decade, or every few, whichever fit in largest number; evenly spaced ones where there are
  // fewer than three of those.
  const ticksOf = (scale, [from, to], extent, length) => {
    const [low, high] = [valueAt(scale, from), valueAt(scale, to)];
    const largest = Math.floor(Math.log10(Math.max(Math.abs(low), Math.abs(high))));
    const lowest = Math.floor(scale === 'log' ? from : Math.log10(scale));
    const decades = (steps, stride, least) => {
      const found = scale === 'log' ? [] : [0];
      for (let decade = lowest; decade <= largest; decade += 1) {
        if (decade % stride !== 0) continue;
        for (const step of steps) {
          const value = Number(`${step}e${decade}`);
          if (scale === 'log') found.push(value);
          else if (value >= least * scale) found.push(value, -value);
        }
      }
      return found.sort((a, b) => a - b);
    };
    const even = (count) => {
      const raw = (high - low) / count;
      const decade = Math.floor(Math.log10(raw));
      const step = [1, 2, 5, 10].find((times) => times * 10 ** decade >= raw) * 10 ** decade;
      const first = Math.ceil(low / step);
      return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, at) => Number(((first + at) * step).toPrecision(12)));
    };
    const fullest = (sets) => sets.map((ticks) => ticks.filter((value) => value >= low && value <= high)).filter((ticks) =>
      ticks.every((value, at) => at === 0 || ((along(scale, value) - along(scale, ticks[at - 1])) / (to - from)) * length >= (extent(value) + extent(ticks[at - 1])) / 2),
    ).reduce((best, ticks) => (ticks.length > best.length ? ticks : best), []);
    const round = fullest([[[1, 2, 3, 4, 5, 6, 8], 1], [[1, 2, 5], 1], ...[1, 2, 5, 10, 20].map((stride) => [[1], stride])].flatMap(([steps, stride]) => [1, 2, 5, 10].map((least) => decades(steps, stride, least))));
    const linear = round.length > 2 ? [] : fullest([8, 7, 6, 5, 4, 3, 2].map(even));
    return linear.length > round.length ? linear : round;
  };

  const colours = () => {
    const style = getComputedStyle(root);
    const of = (name) => style.getPropertyValue(name).trim();
    return { palette: [0, 1, 2, 3, 4, 5, 6].map((at) => of(`--c${at}`)), ink: of('--ink'), soft: of('--soft'), line: of('--line'), paper: of('--paper') };
  };
  // A label over several lines where one has no room.
  const lines = (text, length) => {
    const found = [''];
    for (const word of text.split(' ')) {
      if (found.at(-1) && found.at(-1).length + word.length > length / 6.6) found.push(word);
      else found[found.length - 1] += (found.at(-1) && ' ') + word;
    }
    return found.map(plain).join('<br>');
  };
  // Length of an axis, and what the label of a tick takes up of it (px).
  const lengthOf = (plot, name) => plot._fullLayout?.[name]?._length ?? (name === 'xaxis' ? plot.clientWidth - 76 : 276);
  const extentOf = (name) => (name === 'xaxis' ? (value) => 7 * tickText(value).length + 14 : () => 20);
  const ticked = (plot, name, scale, range) => {
    const ticks = ticksOf(scale, range, extentOf(name), lengthOf(plot, name));
    return { tickvals: ticks.map((value) => laidOut(scale, value)), ticktext: ticks.map(tickText) };
  };
  const axisLayout = (plot, name, axis, scale, values, colour) => {
    const layout = {
      title: { text: lines(axis.label, lengthOf(plot, name)), font: { size: 12 }, standoff: 8 }, gridcolor: colour.line, zerolinecolor: colour.line,
      linecolor: colour.soft, showline: true, ticks: 'outside', tickcolor: colour.soft, automargin: true, exponentformat: 'power', type: 'linear',
    };
    if (axis.places.length > 0) {
      Object.assign(layout, { tickvals: axis.places.map((_, at) => at + 1), ticktext: axis.places.map(plain), range: [0.5, axis.places.length + 0.5] });
    } else {
      layout.range = rangeOf(scale, values);
      if (scale === 'linear' && Math.min(...values) >= 0) layout.range[0] = Math.max(0, layout.range[0]);
      if (scale !== 'linear') Object.assign(layout, { type: scale === 'log' ? 'log' : 'linear' }, ticked(plot, name, scale, layout.range));
    }
    return layout;
  };
  const HOVER = '%{customdata[0]}<br>%{customdata[1]}<extra></extra>';
  const hoverData = (panel, point) => {
    const [curve, x, y, low, high, blocks, rows, mark] = point;
    const [mean, interval] = measured(y, low, high);
    const at = panel.x.places[x - 1] ?? number(x);
    const lost = mark === null ? '' : `<br>open symbol: ${plain(mark)}`;
    return [`<b>${plain(panel.labels[curve])}</b>`, `${plain(panel.y.label)}: <b>${mean}</b><br>95 %: ${interval ?? 'no interval'}<br>at ${plain(at)}<br>${counted(blocks, 'block')}, ${counted(rows, 'row')}${lost}`];
  };
  const curveTraces = (panel, state, colour) => {
    const [x, y] = [(value) => laidOut(state.x, value), (value) => laidOut(state.y, value)];
    return panel.labels.map((label, at) => {
      const points = panel.points.filter((point) => point[0] === at);
      const style = panel.styles[at];
      const tint = colour.palette[style.color % 7];
      // Of a curve with many points, the marked ones have symbols, and the mark beside them.
      const many = points.length > 20 || !style.marker;
      const marks = points.map((point) => point[7]);
      const mode = !many ? 'lines+markers' : marks.some((mark) => mark !== null) ? 'lines+markers+text' : 'lines';
      return {
        type: 'scatter', mode, name: label, visible: !state.off.has(label),
        x: points.map((point) => x(point[1])), y: points.map((point) => y(point[2])),
        error_y: {
          type: 'data', symmetric: false, thickness: 1.1, width: 3, color: tint, visible: points.some((point) => point[3] !== null),
          array: points.map((point) => (point[4] === null ? 0 : y(point[4]) - y(point[2]))),
          arrayminus: points.map((point) => (point[3] === null ? 0 : y(point[2]) - y(point[3]))),
        },
        line: { color: tint, width: 1.8, dash: style.dash },
        text: many ? marks.map((mark) => plain(mark ?? '')) : undefined, textposition: marks.map((mark, place) => (marks.slice(0, place).filter((other) => other !== null).length % 2 ? 'top right' : 'top left')), textfont: { color: tint },
        marker: { symbol: marks.map((mark) => (style.marker || 'circle') + (mark === null ? '' : '-open')), size: many ? marks.map((mark) => (mark === null ? 0 : 9)) : 7, opacity: 1, color: tint, line: { width: 1.6, color: tint } },
        customdata: points.map((point) => hoverData(panel, point)), hovertemplate: HOVER,
      };
    });
  };
  const heatTraces = (panel) => {
    const grid = panel.labels.map(() => panel.x.places.map(() => null));
    const text = grid.map((row) => row.map(() => ['', '']));
    for (const point of panel.points) {
      grid[point[0]][point[1] - 1] = isLog(panel.y.scale) ? Math.log10(point[2]) : point[2];
      text[point[0]][point[1] - 1] = hoverData(panel, point);
    }
    const shown = panel.points.length ? panel.labels.map((_, row) => panel.x.places.map((_, at) => {
      const found = panel.points.find((point) => point[0] === row && point[1] === at + 1);
      return found ? number(found[2]) : '';
    })) : [];
    return [{
      type: 'heatmap', z: grid, x: panel.x.places.map((_, at) => at + 1), y: panel.labels.map((_, at) => at + 1),
      colorscale: 'Viridis', showscale: false, text: shown, texttemplate: panel.x.places.length <= 12 ? '%{text}' : '',
      customdata: text, hovertemplate: HOVER,
    }];
  };
  // By plot: the scales of its axes, and the ranges that they begin with.
  const homes = new WeakMap();
  const goHome = (plot) => Plotly.relayout(plot, { ...homes.get(plot).ranges });
  // After a zoom other ticks are visible. Their labels change the margins, and that no ticks again.
  const reticking = new WeakSet();
  const retick = async (plot) => {
    if (reticking.has(plot)) return;
    const change = {};
    for (const [name, scale] of Object.entries(homes.get(plot).scales)) {
      if (!isLog(scale)) continue;
      const { range, tickvals } = plot._fullLayout[name];
      const ticks = ticked(plot, name, scale, range);
      if (String(ticks.tickvals) === String(tickvals ?? '')) continue;
      change[`${name}.tickvals`] = ticks.tickvals;
      change[`${name}.ticktext`] = ticks.ticktext;
    }
    if (Object.keys(change).length === 0) return;
    reticking.add(plot);
    await Plotly.relayout(plot, change);
    reticking.delete(plot);
  };
  const drawings = new WeakMap();
  const recolour = (plot) => drawings.get(plot)?.();
  const draw = (plot, chart, panel, state) => {
    const colour = colours();
    const seen = panel.points.filter((point) => !state.off.has(panel.labels[point[0]]));
    const values = { x: seen.map((point) => point[1]), y: seen.flatMap((point) => [point[2], point[3] ?? point[2], point[4] ?? point[2]]) };
    const used = { off: state.off };
    for (const axis of ['x', 'y']) used[axis] = scaleOf(panel[axis], state[axis], panel.points.map((point) => point[axis === 'x' ? 1 : 2]));
    const layout = {
      height: 340, margin: { l: 62, r: 14, t: 10, b: 54 }, showlegend: false, hovermode: 'closest', uirevision: `${used.x} ${used.y}`,
      dragmode: matchMedia('(pointer: coarse)').matches ? false : 'zoom',
      font: { family: 'system-ui, sans-serif', size: 12, color: colour.ink }, paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)',
      hoverlabel: { align: 'left', bgcolor: colour.paper, bordercolor: colour.soft, font: { color: colour.ink, size: 12 } },
      xaxis: axisLayout(plot, 'xaxis', panel.x, chart.heat ? 'places' : used.x, values.x, colour),
      yaxis: chart.heat
        ? { tickvals: panel.labels.map((_, at) => at + 1), ticktext: panel.labels.map(plain), automargin: true, title: { text: '' }, range: [0.5, panel.labels.length + 0.5] }
        : axisLayout(plot, 'yaxis', panel.y, used.y, values.y, colour),
    };
    const scales = { xaxis: chart.heat || panel.x.places.length ? 'places' : used.x, yaxis: chart.heat ? 'places' : used.y };
    homes.set(plot, { scales, ranges: { 'xaxis.range': layout.xaxis.range, 'yaxis.range': layout.yaxis.range } });
    const traces = chart.heat ? heatTraces(panel) : curveTraces(panel, used, colour);
    const config = { displayModeBar: false, displaylogo: false, responsive: true, showTips: false, doubleClick: false };
    drawings.set(plot, () => draw(plot, chart, panel, state));
    const isNew = !plot.classList.contains('drawn');
    plot.classList.add('drawn');
    return Plotly.react(plot, traces, layout, config).then(() => {
      if (isNew) {
        plot.on('plotly_relayout', () => retick(plot));
        plot.on('plotly_doubleclick', () => goHome(plot));
      }
      return retick(plot);
    });
  };

  let plotly = null;
  const loadPlotly = () => {
    plotly ??= inflate('plotly').then((text) => {
      const script = document.createElement('script');
      script.textContent = text;
      document.head.append(script);
      performance.mark('plotly');
    });
    return plotly;
  };
  const drawChart = async (figure) => {
    if (figure.dataset.drawn) return;
    figure.dataset.drawn = 'soon';
    const [{ charts }] = await Promise.all([data(figure.dataset.packed), loadPlotly()]);
    const chart = charts[figure.dataset.chart];
    const state = { x: null, y: null, off: new Set() };
    const plots = $$('.plot', figure);
    const resets = [];
    const redraw = () => Promise.all(plots.map((plot, at) => draw(plot, chart, chart.panels[at], state)));
    for (const axis of ['x', 'y']) {
      const button = figure.querySelector(`[data-do="${axis}-scale"]`);
      if (!button) continue;
      const isPressed = chart.panels.some((panel) => isLog(panel[axis].scale));
      const press = (asked) => {
        state[axis] = asked;
        button.setAttribute('aria-pressed', String(asked ?? isPressed));
      };
      press(null);
      // Pressed again, each panel has its own scale again.
      button.addEventListener('click', () => {
        press(state[axis] === null ? !isPressed : null);
        redraw();
      });
      resets.push(() => press(null));
    }
    for (const button of $$('.curve', figure)) {
      button.addEventListener('click', () => {
        const on = button.getAttribute('aria-pressed') !== 'true';
        button.setAttribute('aria-pressed', String(on));
        state.off[on ? 'delete' : 'add'](button.dataset.curve);
        redraw();
      });
    }
    const zoom = (factor) => {
      for (const plot of plots) {
        const change = {};
        for (const name of ['xaxis', 'yaxis']) {
          const [from, to] = plot._fullLayout[name].range;
          const [least, most] = homes.get(plot).ranges[`${name}.range`];
          // Far out there is nothing to see, and numbers overflow.
          const [middle, half] = [(from + to) / 2, Math.min(((to - from) / 2) * factor, most - least)];
          change[`${name}.range`] = [middle - half, middle + half];
        }
        Plotly.relayout(plot, change);
      }
    };
    const reset = async () => {
      resets.forEach((each) => each());
      await redraw();
      plots.forEach(goHome);
    };
    const act = { 'zoom-in': () => zoom(0.6), 'zoom-out': () => zoom(1 / 0.6), 'zoom-reset': reset };
    for (const [name, action] of Object.entries(act)) figure.querySelector(`[data-do="${name}"]`).addEventListener('click', action);
    await redraw();
    figure.dataset.drawn = 'yes';
    performance.mark('chart');
  };
  const near = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      if (!isIntersecting) continue;
      near.unobserve(target);
      drawChart(target);
    }
  }, { rootMargin: '600px' });

  // Tables: a value and its interval are one cell; copies as CSV have all columns and digits.
  const ENDS = ['_low', '_high', '_sd'];
  const merged = (table) => {
    const at = new Map(table.columns.map((column, place) => [column.name, place]));
    const isPart = (name) => ENDS.some((end) => name.endsWith(end) && at.has(name.slice(0, -end.length)));
    return table.columns.flatMap((column, place) => {
      if (isPart(column.name)) return [];
      const ends = [at.get(`${column.name}_low`), at.get(`${column.name}_high`)];
      const hasEnds = ends.every((end) => end !== undefined);
      // Settings stand as they were set.
      const isShort = !hasEnds && table.rows.every((row) => typeof row[place] !== 'number' || String(row[place]).length < 8);
      return [{ ...column, place, ends: hasEnds ? ends : null, isShort }];
    });
  };
  const cellText = (row, column) => {
    const value = row[column.place];
    if (value === null) return '';
    if (typeof value === 'boolean') return value ? 'yes' : 'no';
    if (typeof value !== 'number') return value;
    if (column.isShort) return String(value).replace('-', '−');
    const [mean, interval] = measured(value, ...(column.ends ?? []).map((end) => row[end]));
    return interval ? `${mean} (${interval})` : mean;
  };
  const quoted = (value) => {
    let text = value === null ? '' : String(value);
    if (typeof value === 'string' && /^[=+\-@\t\r]/.test(text)) text = `'${text}`;
    return /[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  const FORMATS = {
    CSV: (table, columns, rows) => [table.columns.map((column) => column.name), ...rows].map((row) => row.map(quoted).join(',')).join('\n') + '\n',
    Markdown: (table, columns, rows) => {
      const safe = (text) => text.replace(/[\\`*_[\]<>&|~$@#]/g, '\\$&');
      const line = (cells) => `| ${cells.map(safe).join(' | ')} |\n`;
      return line(columns.map((column) => column.name)) + `|${columns.map(() => '---').join('|')}|\n` + rows.map((row) => line(columns.map((column) => cellText(row, column)))).join('');
    },
    LaTeX: (table, columns, rows) => {
      const marks = { '\\': '\\textbackslash{}', '~': '\\textasciitilde{}', '^': '\\textasciicircum{}', '−': '$-$', 'σ': '$\\sigma$' };
      const safe = (text) => text.replace(/[\\~^−σ]|[&%$#_{}]/g, (c) => marks[c] ?? `\\${c}`).replace(' to ', '--');
      const line = (cells) => `${cells.map(safe).join(' & ')} \\\\\n`;
      return `\\begin{tabular}{${'l'.repeat(columns.length)}}\n\\toprule\n` + line(columns.map((column) => column.name)) + '\\midrule\n' + rows.map((row) => line(columns.map((column) => cellText(row, column)))).join('') + '\\bottomrule\n\\end{tabular}\n';
    },
  };
  const copy = async (text, what) => {
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      const area = element('textarea', { 'aria-hidden': 'true', class: 'hidden' });
      area.value = text;
      document.body.append(area);
      area.select();
      document.execCommand('copy');
      area.remove();
    }
    say(`Copied ${what}`);
  };
  // The points of a chart as the table that stands beside its figure.
  const pointsOf = (chart) => ({
    title: `Values of ${chart.name}`,
    columns: ['panel', 'measure', 'curve', 'x', 'y', 'y_low', 'y_high', 'blocks', 'rows', 'mark'].map((name) => {
      const labels = new Set(chart.panels.map((panel) => panel[name]?.label));
      return { name, label: labels.size === 1 ? [...labels][0] ?? name : name };
    }),
    rows: chart.panels.flatMap((panel) => panel.points.map(([curve, x, ...rest]) => [panel.title, panel.y.label, panel.labels[curve], panel.x.places[x - 1] ?? x, ...rest])),
  });
  // Fills what is opened for the first time.
  const fill = (details, make) => details.addEventListener('toggle', async () => {
    if (!details.open || details.dataset.listed) return;
    details.dataset.listed = 'soon';
    details.append(...await make(details));
    details.dataset.listed = 'yes';
  });
  const scrolled = (label, table) => element('div', { class: 'scroll', tabindex: '0', role: 'group', 'aria-label': label }, table);
  const SHOWN = 200;
  let tables = 0;
  const listTable = async (details) => {
    const { charts, tables: listed } = await data(details.dataset.packed);
    const table = details.dataset.chart ? pointsOf(charts[details.dataset.chart]) : listed[details.dataset.table];
    const columns = merged(table);
    let [rows, sorted, ascending, limit] = [table.rows, null, true, SHOWN];
    const search = element('input', { type: 'search', id: `filter-${++tables}`, placeholder: 'Filter' });
    const tools = element('div', { class: 'listed-tools tools' }, element('label', { class: 'hidden', for: search.id }, `Filter ${table.title}`), search);
    for (const [name, make] of Object.entries(FORMATS)) {
      const button = element('button', { type: 'button', 'data-copy': name }, `Copy ${name}`);
      button.addEventListener('click', () => copy(make(table, columns, rows), `${rows.length} rows as ${name}`));
      tools.append(button);
    }
    const count = element('span', { role: 'status' });
    tools.append(count);
    const body = element('tbody');
    const heads = columns.map((column) => {
      const button = element('button', { type: 'button', title: column.name }, column.label);
      const head = element('th', { scope: 'col' }, button);
      button.addEventListener('click', () => {
        [ascending, sorted] = [sorted === column ? !ascending : true, column];
        for (const other of heads) other.removeAttribute('aria-sort');
        head.setAttribute('aria-sort', ascending ? 'ascending' : 'descending');
        list();
      });
      return head;
    });
    const more = element('button', { type: 'button' }, 'Show all');
    const order = (a, b) => (typeof a === 'number' && typeof b === 'number' ? a - b : String(a).localeCompare(String(b), 'en', { numeric: true }));
    // A minus sign is found by what keyboards have for it.
    const sought = (text) => text.toLowerCase().replaceAll('−', '-');
    const list = () => {
      const words = sought(search.value).split(/\s+/).filter(Boolean);
      rows = table.rows.filter((row) => {
        const text = sought(columns.map((column) => cellText(row, column)).join(' '));
        return words.every((word) => text.includes(word));
      });
      if (sorted) {
        const isEmpty = (row) => row[sorted.place] === null;
        const filled = rows.filter((row) => !isEmpty(row)).sort((a, b) => (ascending ? 1 : -1) * order(a[sorted.place], b[sorted.place]));
        rows = [...filled, ...rows.filter(isEmpty)];
      }
      body.replaceChildren(...rows.slice(0, limit).map((row) => element('tr', {}, ...columns.map((column) => {
        const text = element('bdi', {}, cellText(row, column));
        return element('td', typeof row[column.place] === 'number' ? { class: 'number' } : {}, text);
      }))));
      count.textContent = `${rows.length} of ${table.rows.length} rows`;
      more.hidden = rows.length <= limit;
    };
    search.addEventListener('input', list);
    more.addEventListener('click', () => { limit = Infinity; list(); });
    list();
    const shown = element('table', { class: 'listed' }, element('caption', {}, table.title), element('thead', {}, element('tr', {}, ...heads)), body);
    return [tools, scrolled(table.title, shown), more];
  };

  // The table of a comparison: data sets by sizes, symbols with words, so that nothing depends on colour.
  const SYMBOLS = { first: '▲', second: '▼', open: '·', none: '–' };
  const compare = async (details) => {
    const { sizes, rows, words: [better, worse] } = (await data(details.dataset.packed))[details.dataset.comparison];
    const words = { first: better, second: worse, open: 'not decided', none: 'not tested' };
    const title = $$('summary bdi', details).map((part) => part.textContent);
    const cell = (test) => {
      if (!test) return element('td');
      const winner = test.winner ?? 'none';
      return element('td', { class: winner, title: test.detail }, element('span', { 'aria-hidden': 'true' }, SYMBOLS[winner]), element('span', { class: 'hidden' }, `${words[winner]}: `), ` ${test.effect}`);
    };
    const heads = ['data set', ...sizes.map((size) => size || 'effect')].map((head) => element('th', { scope: 'col' }, head));
    const body = rows.map(({ place, cells }) => element('tr', {}, element('th', { scope: 'row' }, element('bdi', {}, place)), ...cells.map(cell)));
    const caption = element('caption', {}, element('bdi', {}, title[0]), `: ▲ ${better}, ▼ ${worse}, · not decided`);
    const shown = element('table', { class: 'tests' }, caption, element('thead', {}, element('tr', {}, ...heads)), element('tbody', {}, ...body));
    return [scrolled(title.join(', '), shown)];
  };

  // Figures for print.
  const save = (blob, name) => {
    const link = element('a', { download: name, href: URL.createObjectURL(blob) });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  };
  const showFigure = async (figure) => {
    if (figure.dataset.shown) return;
    figure.dataset.shown = 'soon';
    const svg = new Blob([await packed(figure.dataset.figure)], { type: 'image/svg+xml' });
    const image = element('img', { alt: `Figure ${figure.querySelector('bdi').textContent}`, src: URL.createObjectURL(svg) });
    figure.append(image);
    await image.decode();
    const name = figure.dataset.file.replace(/[^\w.+-]+/g, '_');
    figure.querySelector('[data-do="svg"]').addEventListener('click', () => save(svg, `${name}.svg`));
    figure.querySelector('[data-do="png"]').addEventListener('click', () => {
      const canvas = element('canvas');
      const [width, height] = [image.naturalWidth, image.naturalHeight];
      const scale = Math.min(3, 16000 / Math.max(width, height));
      [canvas.width, canvas.height] = [width * scale, height * scale];
      const context = canvas.getContext('2d');
      context.fillStyle = '#ffffff';
      context.fillRect(0, 0, canvas.width, canvas.height);
      context.drawImage(image, 0, 0, canvas.width, canvas.height);
      canvas.toBlob((blob) => save(blob, `${name}.png`), 'image/png');
    });
    figure.dataset.shown = 'yes';
  };

  for (const figure of $$('.chart')) near.observe(figure);
  for (const details of $$('details.table')) fill(details, listTable);
  for (const details of $$('details.comparison')) fill(details, compare);
  for (const details of $$('details.figures')) details.addEventListener('toggle', () => details.open && $$('figure', details).forEach(showFigure));
  // A link to what is folded away opens it.
  const reveal = () => {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    for (let at = target; at; at = at.parentElement) if (at.tagName === 'DETAILS') at.open = true;
    target.scrollIntoView();
  };
  addEventListener('hashchange', reveal);
  for (const button of $$('.code [data-do="copy"]')) button.addEventListener('click', () => copy(button.nextElementSibling.textContent, 'the text'));

  const folders = () => $$('details.folder, details.comparison');
  const drawAll = async () => {
    for (const figure of $$('.chart')) if (figure.offsetParent) await drawChart(figure);
  };
  const ACTIONS = {
    theme: () => {
      theme = { auto: 'light', light: 'dark', dark: 'auto' }[theme] ?? 'auto';
      try { localStorage.setItem('mcl-eval-theme', theme); } catch { /* a page may be opened where nothing is kept */ }
      applyTheme();
      say(`Colours: ${theme}`);
    },
    open: () => folders().forEach((details) => { details.open = true; }),
    close: () => folders().forEach((details) => { details.open = false; }),
    print: async () => {
      say('Drawing what is open');
      await drawAll();
      status.textContent = '';
      print();
    },
  };
  for (const button of $$('.top [data-do]')) button.addEventListener('click', ACTIONS[button.dataset.do]);
  // Paper is white, and narrower than the window.
  let opened = [];
  addEventListener('beforeprint', () => {
    applyTheme('light');
    // What carries the answer and what is missing is printed, open or not.
    opened = $$('details.printed:not([open])');
    opened.forEach((details) => { details.open = true; });
    for (const plot of $$('.plot.drawn')) Plotly.relayout(plot, { width: $$('.panel', plot.closest('.panels')).length > 1 ? 330 : 680 });
  });
  addEventListener('afterprint', () => {
    applyTheme();
    opened.forEach((details) => { details.open = false; });
    for (const plot of $$('.plot.drawn')) Plotly.relayout(plot, { width: undefined, autosize: true });
  });
  dark.addEventListener('change', () => applyTheme());
  applyTheme();
  if (innerWidth < 1120) document.querySelector('.contents details').open = false;
  reveal();

  const links = new Map($$('.contents a').map((link) => [link.hash.slice(1), link]));
  const sections = $$('main > section');
  const inBand = new Set();
  const spy = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) inBand[isIntersecting ? 'add' : 'delete'](target);
    const current = sections.findLast((section) => inBand.has(section));
    for (const section of sections) links.get(section.id)?.setAttribute('aria-current', String(section === current));
  }, { rootMargin: '-20% 0px -70% 0px' });
  for (const section of sections) spy.observe(section);
  performance.mark('ready');
})();
