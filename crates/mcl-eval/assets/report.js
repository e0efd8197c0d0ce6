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
  const number = (value) => {
    const size = Math.abs(value);
    if (Number.isInteger(value) && size < 1e7) return String(value).replace('-', '−');
    const decimals = size >= 100 ? 0 : size >= 1 ? 2 : size >= 0.01 ? 3 : size >= 1e-4 ? 5 : -1;
    return (decimals < 0 ? value.toExponential(1) : value.toFixed(decimals)).replaceAll('-', '−');
  };
  // plotly takes some markup in labels; names are none.
  const plain = (text) => text.replaceAll('&', '&amp;').replaceAll('<', '&lt;').replaceAll('>', '&gt;');

  // Scales. plotly has no logarithm of both signs: values are laid out here, and ticks named.
  const LINEAR_BELOW = { symlog: 1, 'symlog-fine': 0.1 };
  const symlog = (below) => (value) =>
    Math.abs(value) <= below ? value / below : Math.sign(value) * (1 + Math.log10(Math.abs(value) / below));
  const symlogTicks = (below, values) => {
    const ticks = [0];
    const [low, high] = [Math.min(...values), Math.max(...values)];
    for (let at = below; at <= Math.max(-low, high); at *= 10) {
      if (at <= high) ticks.push(at);
      if (-at >= low) ticks.unshift(-at);
    }
    return ticks;
  };
  // 1, 2, 5 of each decade where they fit, else decades; in plain digits.
  const logTicks = (values) => {
    const positive = values.filter((value) => value > 0).map(Math.log10);
    const [low, high] = [Math.floor(Math.min(...positive)) - 1, Math.ceil(Math.max(...positive)) + 1];
    const steps = high - low > 6 ? [1] : [1, 2, 5];
    const ticks = [];
    for (let decade = low; decade <= high; decade += 1) ticks.push(...steps.map((step) => Number(`${step}e${decade}`)));
    return ticks;
  };
  const tickText = (value) => (value !== 0 && (Math.abs(value) < 1e-4 || Math.abs(value) >= 1e6) ? value.toExponential() : String(value)).replaceAll('-', '−');
  const isLog = (scale) => scale !== 'linear' && scale !== 'places';
  const logOf = (axis, values) => {
    if (isLog(axis.scale)) return axis.scale;
    return values.every((value) => value > 0) ? 'log' : 'symlog';
  };

  const colours = () => {
    const style = getComputedStyle(root);
    const of = (name) => style.getPropertyValue(name).trim();
    return { palette: [0, 1, 2, 3, 4, 5, 6].map((at) => of(`--c${at}`)), ink: of('--ink'), soft: of('--soft'), line: of('--line'), paper: of('--paper') };
  };
  const axisLayout = (axis, scale, values, colour) => {
    const layout = {
      title: { text: plain(axis.label), font: { size: 12 }, standoff: 8 }, gridcolor: colour.line, zerolinecolor: colour.line,
      linecolor: colour.soft, showline: true, ticks: 'outside', tickcolor: colour.soft, automargin: true, exponentformat: 'power', type: 'linear',
    };
    if (axis.places.length > 0) {
      Object.assign(layout, { tickvals: axis.places.map((_, at) => at + 1), ticktext: axis.places.map(plain), range: [0.5, axis.places.length + 0.5] });
    } else if (scale === 'log') {
      const ticks = logTicks(values);
      Object.assign(layout, { type: 'log', tickvals: ticks, ticktext: ticks.map(tickText) });
    } else if (LINEAR_BELOW[scale]) {
      const ticks = symlogTicks(LINEAR_BELOW[scale], values);
      Object.assign(layout, { tickvals: ticks.map(symlog(LINEAR_BELOW[scale])), ticktext: ticks.map(tickText) });
    }
    return layout;
  };
  const HOVER = '%{customdata[0]}<br>%{customdata[1]}<extra></extra>';
  const hoverData = (panel, point) => {
    const [curve, x, y, low, high, blocks, rows, mark] = point;
    const interval = low === null ? 'no interval' : `${number(low)} to ${number(high)}`;
    const at = panel.x.places[x - 1] ?? number(x);
    const lost = mark === null ? '' : `<br>open symbol: ${plain(mark)}`;
    return [`<b>${plain(panel.labels[curve])}</b>`, `${plain(panel.y.label)}: <b>${number(y)}</b><br>95 %: ${interval}<br>at ${plain(at)}<br>${blocks} blocks, ${rows} rows${lost}`];
  };
  const curveTraces = (panel, state, colour) => {
    const x = (value) => (LINEAR_BELOW[state.x] ? symlog(LINEAR_BELOW[state.x])(value) : value);
    const y = (value) => (LINEAR_BELOW[state.y] ? symlog(LINEAR_BELOW[state.y])(value) : value);
    return panel.labels.map((label, at) => {
      const points = panel.points.filter((point) => point[0] === at);
      const style = panel.styles[at];
      const tint = colour.palette[style.color % 7];
      const many = points.length > 20 || !style.marker;
      return {
        type: 'scatter', mode: many ? 'lines' : 'lines+markers', name: label, visible: !state.off.has(label),
        x: points.map((point) => x(point[1])), y: points.map((point) => y(point[2])),
        error_y: {
          type: 'data', symmetric: false, thickness: 1.1, width: 3, color: tint, visible: points.some((point) => point[3] !== null),
          array: points.map((point) => (point[4] === null ? 0 : y(point[4]) - y(point[2]))),
          arrayminus: points.map((point) => (point[3] === null ? 0 : y(point[2]) - y(point[3]))),
        },
        line: { color: tint, width: 1.8, dash: style.dash },
        marker: { symbol: points.map((point) => (style.marker || 'circle') + (point[7] === null ? '' : '-open')), size: 7, color: tint, line: { width: 1.6, color: tint } },
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
  const drawings = new WeakMap();
  const recolour = (plot) => drawings.get(plot)?.();
  const draw = (plot, chart, panel, state) => {
    const colour = colours();
    const values = { x: panel.points.map((point) => point[1]), y: panel.points.flatMap((point) => [point[2], point[3] ?? point[2], point[4] ?? point[2]]) };
    const used = { off: state.off, x: state.x === null ? panel.x.scale : state.x ? logOf(panel.x, values.x) : 'linear', y: state.y === null ? panel.y.scale : state.y ? logOf(panel.y, panel.points.map((point) => point[2])) : 'linear' };
    const layout = {
      height: 340, margin: { l: 62, r: 14, t: 10, b: 54 }, showlegend: false, hovermode: 'closest', uirevision: `${used.x} ${used.y}`,
      dragmode: matchMedia('(pointer: coarse)').matches ? false : 'zoom',
      font: { family: 'system-ui, sans-serif', size: 12, color: colour.ink }, paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)',
      hoverlabel: { align: 'left', bgcolor: colour.paper, bordercolor: colour.soft, font: { color: colour.ink, size: 12 } },
      xaxis: axisLayout(panel.x, chart.heat ? 'places' : used.x, values.x, colour),
      yaxis: chart.heat
        ? { tickvals: panel.labels.map((_, at) => at + 1), ticktext: panel.labels.map(plain), automargin: true, title: { text: '' } }
        : axisLayout(panel.y, used.y, values.y, colour),
    };
    const traces = chart.heat ? heatTraces(panel) : curveTraces(panel, used, colour);
    const config = { displayModeBar: false, displaylogo: false, responsive: true, showTips: false, doubleClick: 'reset' };
    drawings.set(plot, () => draw(plot, chart, panel, state));
    plot.classList.add('drawn');
    return Plotly.react(plot, traces, layout, config);
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
    const redraw = () => Promise.all(plots.map((plot, at) => draw(plot, chart, chart.panels[at], state)));
    for (const axis of ['x', 'y']) {
      const button = figure.querySelector(`[data-do="${axis}-scale"]`);
      if (!button) continue;
      button.setAttribute('aria-pressed', String(chart.panels.some((panel) => isLog(panel[axis].scale))));
      button.addEventListener('click', () => {
        state[axis] = button.getAttribute('aria-pressed') !== 'true';
        button.setAttribute('aria-pressed', String(state[axis]));
        redraw();
      });
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
          const [middle, half] = [(from + to) / 2, ((to - from) / 2) * factor];
          change[`${name}.range`] = [middle - half, middle + half];
        }
        Plotly.relayout(plot, change);
      }
    };
    const act = { 'zoom-in': () => zoom(0.6), 'zoom-out': () => zoom(1 / 0.6), 'zoom-reset': () => plots.forEach((plot) => Plotly.relayout(plot, { 'xaxis.autorange': true, 'yaxis.autorange': true })) };
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
      return [{ ...column, place, ends: ends.every((end) => end !== undefined) ? ends : null }];
    });
  };
  const cellText = (row, column) => {
    const value = row[column.place];
    if (value === null) return '';
    if (typeof value === 'boolean') return value ? 'yes' : 'no';
    if (typeof value !== 'number') return value;
    const ends = column.ends?.map((end) => row[end]);
    const hasEnds = ends?.every((end) => end !== null) && ends[0] !== ends[1];
    // Settings stand as they were set.
    if (!column.ends && String(value).length < 8) return String(value).replace('-', '−');
    return hasEnds ? `${number(value)} (${number(ends[0])} to ${number(ends[1])})` : number(value);
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
    columns: ['panel', 'curve', 'x', 'y', 'y_low', 'y_high', 'blocks', 'rows', 'mark'].map((name) => ({ name, label: name })),
    rows: chart.panels.flatMap((panel) => panel.points.map(([curve, x, ...rest]) => [panel.title, panel.labels[curve], panel.x.places[x - 1] ?? x, ...rest])),
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
    const order = (a, b) => (a === null || b === null ? (a === null) - (b === null) : typeof a === 'number' && typeof b === 'number' ? a - b : String(a).localeCompare(String(b), 'en', { numeric: true }));
    const list = () => {
      const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
      rows = table.rows.filter((row) => {
        const text = columns.map((column) => cellText(row, column)).join(' ').toLowerCase();
        return words.every((word) => text.includes(word));
      });
      if (sorted) rows = rows.slice().sort((a, b) => (ascending ? 1 : -1) * order(a[sorted.place], b[sorted.place]));
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
  addEventListener('beforeprint', () => {
    applyTheme('light');
    for (const plot of $$('.plot.drawn')) Plotly.relayout(plot, { width: $$('.panel', plot.closest('.panels')).length > 1 ? 330 : 680 });
  });
  addEventListener('afterprint', () => {
    applyTheme();
    for (const plot of $$('.plot.drawn')) Plotly.relayout(plot, { width: undefined, autosize: true });
  });
  dark.addEventListener('change', () => applyTheme());
  applyTheme();
  if (innerWidth < 1120) document.querySelector('.contents details').open = false;
  reveal();

  const links = new Map($$('.contents a').map((link) => [link.hash.slice(1), link]));
  const spy = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      if (isIntersecting) links.get(target.id)?.setAttribute('aria-current', 'true');
      else links.get(target.id)?.removeAttribute('aria-current');
    }
  }, { rootMargin: '-20% 0px -70% 0px' });
  for (const section of $$('main > section')) spy.observe(section);
  performance.mark('ready');
})();
