import assert from 'node:assert/strict';
import { readFileSync, statSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { ROOT, close, drawn, hostile, open, report, withRows } from './browser.mjs';

const AXE = readFileSync(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8');
let rows, committed, bad;

before(() => {
  rows = report('rows', withRows());
  committed = report('committed', join(ROOT, 'results'));
  bad = report('hostile', hostile());
}, { timeout: 900000 });
after(close);

const findings = async (page) => {
  // Scripts from outside are what the page's policy forbids; the debugger may still evaluate.
  await page.evaluate(AXE);
  const { violations } = await page.evaluate(() => window.axe.run(document, { resultTypes: ['violations'] }));
  return violations.map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map((node) => node.html.slice(0, 160)).join(' | ')}`);
};
const clipboard = (page) => page.evaluate(() => navigator.clipboard.readText());

test('the committed results: at most 6 MB, painted within a second, nothing asked for, nothing shifts', async () => {
  assert.ok(statSync(committed).size <= 6e6, `${statSync(committed).size} bytes`);
  const times = [];
  for (let turn = 0; turn < 3; turn += 1) {
    const { page, problems, context } = await open(committed);
    await page.waitForTimeout(500);
    times.push(await page.evaluate(() => performance.getEntriesByName('first-contentful-paint')[0].startTime));
    if (turn === 2) {
      for (let at = 0; at < 12; at += 1) {
        await page.mouse.wheel(0, 700);
        await page.waitForTimeout(150);
      }
      assert.ok((await page.evaluate(() => window.shifts)) < 0.02, `shifts by ${await page.evaluate(() => window.shifts)}`);
    }
    assert.deepEqual(problems, []);
    await context.close();
  }
  console.log(`first paint after ${times.map((time) => time.toFixed(0)).join(', ')} ms; ${statSync(committed).size} bytes`);
  assert.ok(Math.min(...times) < 1000, `${times}`);
});

test('what was run, the answer, the claims, in this order', async () => {
  const { page, context } = await open(rows);
  const titles = await page.locator('main h2').allTextContents();
  assert.deepEqual(titles, ['What was run', 'The answer', 'The paper’s claims', 'likelihood', 'localization']);
  assert.match(await page.locator('#answer').textContent(), /gbs\+f-km against gbs.*(Better|No difference|Worse)/s);
  assert.match(await page.locator('#claims .lead').textContent(), /\d+ reproduced.*\d+ not reproduced.*\d+ not testable/s);
  const verdict = page.locator('.verdict').first();
  await verdict.locator('summary').click();
  assert.ok(await verdict.locator('div').isVisible());
  await context.close();
});

test('charts: hover shows value, interval and blocks; curves, scales and zoom', async () => {
  const { page, problems, context } = await open(rows);
  const chart = page.locator('.chart').first();
  await drawn(chart);
  const ranges = () => chart.locator('.plot').first().evaluate((plot) => [plot._fullLayout.xaxis.range, plot._fullLayout.yaxis.range, plot._fullLayout.xaxis.type]);
  const point = chart.locator('.scatterlayer .points path').first();
  await point.hover({ force: true });
  await page.waitForFunction(() => document.querySelector('.hoverlayer text'));
  const hover = await chart.locator('.hoverlayer').first().textContent();
  assert.match(hover, /gbs/);
  assert.match(hover, /95 %: .* to .*4 blocks, 4 rows/s);
  const curves = () => chart.locator('.plot').first().evaluate((plot) => plot._fullData.filter((trace) => trace.visible === true).length);
  const all = await curves();
  await chart.locator('.curve').first().click();
  assert.equal(await curves(), all - 1);
  assert.equal(await chart.locator('.curve').first().getAttribute('aria-pressed'), 'false');
  await chart.locator('.curve').first().click();
  const before = await ranges();
  assert.equal(before[2], 'log');
  const [scale, reset] = ['x-scale', 'zoom-reset'].map((name) => chart.locator(`[data-do="${name}"]`));
  // Pressed twice it is as it was.
  for (const type of ['linear', 'log']) {
    await scale.click();
    assert.equal((await ranges())[2], type);
    assert.equal(await scale.getAttribute('aria-pressed'), String(type === 'log'));
  }
  assert.deepEqual(await ranges(), before);
  // So it is after a reset.
  await scale.click();
  await chart.locator('[data-do="zoom-in"]').click();
  await reset.click();
  await page.waitForFunction((plot) => plot._fullLayout.xaxis.type === 'log', await chart.locator('.plot').first().elementHandle());
  assert.deepEqual(await ranges(), before);
  await chart.locator('[data-do="zoom-in"]').click();
  const zoomed = await ranges();
  assert.ok(zoomed[0][1] - zoomed[0][0] < before[0][1] - before[0][0]);
  const box = await chart.locator('.plot').first().boundingBox();
  await page.mouse.dblclick(box.x + box.width / 2, box.y + box.height / 2);
  await page.waitForFunction(([plot, from]) => plot._fullLayout.xaxis.range[0] === from, [await chart.locator('.plot').first().elementHandle(), before[0][0]]);
  assert.deepEqual(problems, []);
  await context.close();
});

test('logarithmic axes have at least three ticks, after a zoom, too', async () => {
  const { page, problems, context } = await open(committed);
  // The first data set of each study, which is open.
  for (const chart of await page.locator('.folder[open] .chart:has([data-do="x-scale"])').all()) {
    await drawn(chart);
    const few = () => chart.evaluate((figure) => [...figure.querySelectorAll('.plot')].flatMap((plot) => ['x', 'y'].filter((axis) => {
      const { type, tickvals } = plot._fullLayout[`${axis}axis`];
      return (type === 'log' || tickvals?.length) && plot.querySelectorAll(`.${axis}tick text`).length < 3;
    }).map((axis) => `${figure.querySelector('h4').textContent}, ${axis}`)));
    assert.deepEqual(await few(), []);
    for (let turn = 0; turn < 2; turn += 1) await chart.locator('[data-do="zoom-in"]').click();
    await page.waitForTimeout(200);
    assert.deepEqual(await few(), []);
  }
  assert.deepEqual(problems, []);
  await context.close();
});

test('of a curve with many points the marked ones have symbols', async () => {
  const { page, context } = await open(committed);
  const chart = page.locator('.chart').filter({ hasText: 'size-by-likelihood' }).first();
  await drawn(chart);
  const [trace, texts] = await chart.locator('.plot').first().evaluate((plot) => {
    const { mode, marker } = plot._fullData[0];
    return [{ mode, open: marker.symbol.filter((symbol, at) => symbol.endsWith('-open') && marker.size[at] > 0).length, drawn: marker.size.filter((size) => size > 0).length }, [...plot.querySelectorAll('.textpoint text')].map((text) => text.textContent).filter(Boolean)];
  });
  assert.deepEqual(trace, { mode: 'lines+markers+text', open: 3, drawn: 3 });
  assert.deepEqual(texts.sort(), ['bic', 'held-out', 'mdl']);
  await context.close();
});

test('tables: sorted, filtered, copied as CSV, Markdown and LaTeX', async () => {
  const { page, problems, context } = await open(rows);
  const details = page.locator('details.table').filter({ hasText: 'Means and intervals' }).first();
  await details.locator('> summary').click();
  const table = details.locator('table');
  // The table is made once its section has opened, which the browser says later than the click returns.
  await table.locator('thead th').first().waitFor();
  const column = async (name) => {
    const heads = await table.locator('thead th').allTextContents();
    const place = heads.findIndex((head) => head.startsWith(name));
    assert.ok(place >= 0, `${name} among ${heads}`);
    return { place, head: table.locator('thead th').nth(place), cells: () => table.locator(`tbody td:nth-child(${place + 1})`).allTextContents() };
  };
  const likelihood = await column('log-likelihood');
  const numbers = async () => (await likelihood.cells()).map((text) => Number.parseFloat(text.replace('−', '-')));
  await likelihood.head.locator('button').click();
  assert.equal(await likelihood.head.getAttribute('aria-sort'), 'ascending');
  const ascending = await numbers();
  assert.deepEqual(ascending, ascending.slice().sort((a, b) => a - b));
  await likelihood.head.locator('button').click();
  assert.equal(await likelihood.head.getAttribute('aria-sort'), 'descending');
  assert.deepEqual(await numbers(), ascending.slice().reverse());
  // The minus sign that keyboards have finds the one that is shown.
  await details.locator('input').fill((await likelihood.cells())[0].split(' ')[0].replace('−', '-'));
  assert.ok((await table.locator('tbody tr').count()) > 0);
  await details.locator('input').fill('rnd+f-km');
  assert.equal(await table.locator('tbody tr').count(), 2);
  await details.locator('[data-copy="CSV"]').click();
  const csv = (await clipboard(page)).trim().split('\n');
  assert.equal(csv.length, 3);
  assert.ok(csv[0].startsWith('dataset,') && csv[0].includes('log_likelihood_low') && csv[1].includes('rnd+f-km'));
  await details.locator('[data-copy="Markdown"]').click();
  assert.match(await clipboard(page), /^\| dataset \|[^\n]*\n\|---\|/);
  await details.locator('[data-copy="LaTeX"]').click();
  assert.match(await clipboard(page), /\\begin\{tabular\}[^]*log\\_likelihood[^]*\\bottomrule/);
  assert.deepEqual(problems, []);
  await context.close();
});

test('a comparison opens to its effects by data set and size', async () => {
  const { page, problems, context } = await open(rows);
  const comparison = page.locator('details.comparison').first();
  await comparison.locator('summary').click();
  const table = comparison.locator('table.tests');
  await table.waitFor();
  assert.match(await table.locator('caption').textContent(), /^gbs\+f-km against gbs: ▲ better, ▼ worse, · not decided$/);
  const cells = await table.locator('tbody td').allTextContents();
  assert.ok(cells.length > 0);
  for (const cell of cells) assert.match(cell, /^(▲better: |▼worse: |·not decided: |–not tested: ) /);
  assert.match(await table.locator('tbody td').first().getAttribute('title'), /^\d+ blocks, p .* after Holm/);
  assert.deepEqual(problems, []);
  await context.close();
});

test('figures for print are shown, and saved as SVG and PNG', async () => {
  const { page, problems, context } = await open(rows);
  const figures = page.locator('details.figures').first();
  await figures.locator('> summary').click();
  const figure = figures.locator('figure').first();
  await figure.locator('xpath=self::*[@data-shown="yes"]').waitFor({ state: 'attached' });
  for (const [button, start] of [['svg', '<'], ['png', '\x89PNG']]) {
    const [download] = await Promise.all([page.waitForEvent('download'), figure.locator(`[data-do="${button}"]`).click()]);
    assert.ok(download.suggestedFilename().endsWith(`.${button}`));
    assert.ok(readFileSync(await download.path(), 'latin1').startsWith(start));
  }
  assert.deepEqual(problems, []);
  await context.close();
});

test('the keyboard alone: skips to the answer, opens a section, toggles a curve, sorts', async () => {
  const { page, problems, context } = await open(rows);
  await page.keyboard.press('Tab');
  assert.equal(await page.evaluate(() => document.activeElement.className), 'skip');
  await page.keyboard.press('Enter');
  assert.equal(new URL(page.url()).hash, '#answer');
  await drawn(page.locator('.chart').first());
  const until = async (is) => {
    for (let step = 0; step < 400; step += 1) {
      if (await page.evaluate(is)) return;
      await page.keyboard.press('Tab');
    }
    assert.fail(`never reached: ${is}`);
  };
  await until(() => document.activeElement.matches('.curve'));
  assert.notEqual(await page.evaluate(() => getComputedStyle(document.activeElement).outlineStyle), 'none');
  await page.keyboard.press('Space');
  assert.equal(await page.evaluate(() => document.activeElement.getAttribute('aria-pressed')), 'false');
  await until(() => document.activeElement.matches('details.table > summary'));
  await page.keyboard.press('Enter');
  await page.locator('table.listed').first().waitFor();
  await until(() => document.activeElement.matches('.listed th button'));
  await page.keyboard.press('Enter');
  assert.equal(await page.evaluate(() => document.activeElement.closest('th').getAttribute('aria-sort')), 'ascending');
  assert.deepEqual(problems, []);
  await context.close();
});

test('from a telephone to a wide screen nothing sticks out, light and dark', async () => {
  for (const path of [rows, committed, bad]) {
    for (const width of [360, 1920]) {
      for (const theme of ['light', 'dark']) {
        const { page, problems, context } = await open(path, { width, height: 800, theme });
        await page.locator('[data-do="theme"]').waitFor();
        await page.evaluate(() => { for (const details of document.querySelectorAll('details.folder, details.comparison, details.table, details.figures, .verdict')) if (document.querySelectorAll('.folder').length < 9) details.open = true; });
        await page.waitForTimeout(800);
        const sticksOut = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
        assert.ok(sticksOut <= 0, `${path} at ${width}: ${sticksOut} px too wide`);
        assert.equal(await page.evaluate(() => document.documentElement.dataset.theme), theme);
        assert.deepEqual(problems, []);
        await context.close();
      }
    }
  }
});

test('the colours can be switched, and charts follow', async () => {
  const { page, context } = await open(rows);
  await drawn(page.locator('.chart').first());
  const ink = () => page.locator('.plot').first().evaluate((plot) => plot._fullLayout.font.color);
  const light = await ink();
  await page.locator('[data-do="theme"]').click();
  await page.locator('[data-do="theme"]').click();
  assert.equal(await page.evaluate(() => document.documentElement.dataset.theme), 'dark');
  await page.waitForFunction((was) => document.querySelector('.plot')._fullLayout.font.color !== was, light);
  await context.close();
});

test('axe finds nothing', async () => {
  for (const path of [rows, bad, committed]) {
    for (const theme of ['light', 'dark']) {
      const { page, context } = await open(path, { theme });
      await drawn(page.locator('.chart').first());
      await page.evaluate(() => { for (const details of document.querySelectorAll('details.comparison, details.table, .claim, .verdict')) if (document.querySelectorAll('.folder').length < 9) details.open = true; });
      await page.waitForTimeout(500);
      assert.deepEqual(await findings(page), [], `${path}, ${theme}`);
      await context.close();
    }
  }
});

test('prints without controls', async () => {
  const { page, problems, context } = await open(rows);
  await drawn(page.locator('.chart').first());
  await page.emulateMedia({ media: 'print' });
  for (const control of ['.top', '.contents', '[data-do="zoom-in"]']) assert.ok(!(await page.locator(control).first().isVisible()), control);
  // A closed comparison prints its sentence.
  assert.ok(await page.locator('details.comparison:not([open]) .sentence').first().isVisible());
  await page.setViewportSize({ width: 680, height: 900 });
  await page.evaluate(() => { for (const details of document.querySelectorAll('details.comparison, details.table, details.folder')) details.open = true; });
  await page.locator('table.listed').first().waitFor({ state: 'attached' });
  const wide = await page.evaluate(() => [...document.querySelectorAll('table')].filter((table) => table.getBoundingClientRect().right > innerWidth + 1).map((table) => table.className));
  assert.deepEqual(wide, [], 'too wide for paper');
  await page.emulateMedia({ media: null });
  const pdf = await page.pdf({ format: 'A4' });
  assert.ok(pdf.subarray(0, 5).toString() === '%PDF-' && pdf.length > 20000, `${pdf.length} bytes`);
  assert.deepEqual(problems, []);
  await context.close();
});

test('hostile names are text', async () => {
  const { page, problems, context } = await open(bad);
  await drawn(page.locator('.chart').first());
  await page.evaluate(() => { for (const details of document.querySelectorAll('details')) details.open = true; });
  await page.locator('.chart .scatterlayer .points path').first().hover({ force: true });
  await page.waitForTimeout(800);
  assert.equal(await page.evaluate(() => window.hacked), undefined);
  assert.deepEqual(await page.evaluate(() => [...document.querySelectorAll('main img')].filter((image) => !image.src.startsWith('blob:')).length), 0);
  assert.equal(await page.locator('main a[href^="http"], main svg a').count(), 0);
  const text = await page.locator('main').innerText();
  assert.ok(text.includes('<script>window.hacked = 1</script>'));
  assert.ok(text.includes('\\u{202e}') && text.includes('\\u{1b}') && !/[\u202e\u001b]/.test(text));
  assert.deepEqual(problems, []);
  await context.close();
});
