import assert from 'node:assert/strict';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { close, open, program, report, scratch, withRows } from './browser.mjs';

let rows, localized;

before(() => {
  rows = report('watched', withRows());
  const [map, folder] = [join(scratch, 'map.csv'), join(scratch, 'localized')];
  program('map', 'simulated-office', '--init', 'grid', '--size', '1%', '-o', map, '-q');
  program('localize', 'simulated-office', '--map', map, '--runs', '3', '--particles', '100', '-o', folder, '-q');
  localized = report('localized', folder);
}, { timeout: 900000 });
after(close);

/// The first player or comparison of a page, in view and ready.
const ready = async (page, kind) => {
  const slot = page.locator(`.${kind}`).first();
  await slot.scrollIntoViewIfNeeded();
  await slot.locator('xpath=self::*[@data-ready="true"]').waitFor({ state: 'attached', timeout: 60000 });
  return slot;
};
const pixels = (canvas) => canvas.evaluate((element) => element.toDataURL());
/// How many colours a canvas shows: a blank one has one.
const colors = (canvas) => canvas.evaluate((element) => {
  const { data } = element.getContext('2d').getImageData(0, 0, element.width, element.height);
  const found = new Set();
  for (let i = 0; i < data.length; i += 4) found.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
  return found.size;
});
const frame = async (slot) => Number(await slot.getAttribute('data-frame'));

test('a run is played, and the robot moves', async () => {
  const { page, problems, context } = await open(rows);
  const watch = await ready(page, 'watch');
  const scene = watch.locator('.watch-scene').first();
  assert.ok((await colors(scene)) > 20);
  // The keys are named, and a click on the scene takes them.
  assert.match(await watch.locator('.watch-keys').textContent(), /space.*←.*Home/);
  await scene.click();
  assert.equal(await page.evaluate(() => document.activeElement.className), 'watch-scrub');
  const [first, before] = [await frame(watch), await pixels(scene)];
  await watch.locator('.watch-play').click();
  assert.equal(await watch.locator('.watch-play').textContent(), 'Pause');
  await page.waitForFunction(([slot, start]) => Number(slot.dataset.frame) > start + 3, [await watch.elementHandle(), first]);
  await watch.locator('.watch-play').click();
  assert.notEqual(await pixels(scene), before);
  const stopped = await frame(watch);
  await page.waitForTimeout(500);
  assert.equal(await frame(watch), stopped);
  assert.deepEqual(problems, []);
  await context.close();
});

test('the keyboard plays, pauses and goes along the run; readers hear where it stopped, not every step', async () => {
  const { page, problems, context } = await open(rows);
  const watch = await ready(page, 'watch');
  const [scrub, scene] = [watch.locator('.watch-scrub'), watch.locator('.watch-scene').first()];
  const status = watch.locator('.watch-status');
  await scrub.focus();
  await page.keyboard.press('Home');
  assert.equal(await frame(watch), 0);
  const atStart = await pixels(scene);
  await page.keyboard.press('ArrowRight');
  await page.keyboard.press('ArrowRight');
  await page.keyboard.press('ArrowLeft');
  assert.equal(await frame(watch), 1);
  await page.keyboard.press('End');
  assert.equal(String(await frame(watch)), await scrub.getAttribute('max'));
  assert.notEqual(await pixels(scene), atStart);
  await page.keyboard.press('Home');
  await page.waitForTimeout(600);
  const said = await status.textContent();
  assert.match(said, /^0.* of .*best: gbs\+f-km .*d \d/);
  await page.keyboard.press(' ');
  await page.waitForFunction((slot) => Number(slot.dataset.frame) > 4, await watch.elementHandle());
  assert.equal(await watch.getAttribute('data-playing'), 'true');
  assert.equal(await status.textContent(), said);
  await page.keyboard.press(' ');
  assert.equal(await watch.getAttribute('data-playing'), 'false');
  await page.waitForTimeout(600);
  assert.notEqual(await status.textContent(), said);
  assert.match(await scene.getAttribute('aria-label'), /scan .*d \d.*particles/);
  // What has the focus can be seen.
  assert.notEqual(await scrub.evaluate((element) => getComputedStyle(element).outlineStyle), 'none');
  assert.deepEqual(problems, []);
  await context.close();
});

test('a folder of localize says what was run, and has no empty sections', async () => {
  const { page, context } = await open(localized);
  assert.deepEqual(await page.locator('main h2').allTextContents(), ['What was run', 'Runs of localize']);
  assert.deepEqual((await page.locator('.contents a').allTextContents()), ['What was run', 'Runs of localize']);
  assert.match(await page.locator('#localized').textContent(), /log simulated-office.*map .*map\.csv.*100 particles.*Mean weighted error d .*mcl-eval localize simulated-office --map/s);
  await context.close();
});

test('two runs side by side keep the same time', async () => {
  const { page, problems, context } = await open(localized);
  const watch = await ready(page, 'watch');
  assert.match(await watch.textContent(), /Of 3 runs of localize/);
  const [left, right] = [0, 1].map((place) => watch.locator('.watch-pane').nth(place));
  assert.deepEqual(await left.locator('option').allTextContents(), (await right.locator('option').allTextContents()).slice(1));
  const scans = () => Promise.all([left, right].map(async (pane) => (await pane.locator('.watch-numbers').textContent()).match(/scan ([\d,]+)/)[1]));
  for (const key of ['Home', 'End', 'ArrowLeft']) {
    await watch.locator('.watch-scrub').press(key);
    const [ofLeft, ofRight] = await scans();
    assert.equal(ofLeft, ofRight, key);
  }
  const before = await pixels(right.locator('canvas'));
  await right.locator('select').selectOption({ index: 1 });
  assert.notEqual(await pixels(right.locator('canvas')), before);
  assert.equal(await left.locator('.watch-numbers').textContent(), await right.locator('.watch-numbers').textContent());
  // Pointing at the errors goes there.
  const errors = watch.locator('.watch-errors');
  const box = await errors.boundingBox();
  await errors.click({ position: { x: 46, y: box.height / 2 } });
  assert.ok((await frame(watch)) < 5);
  assert.deepEqual(problems, []);
  await context.close();
});

test('who wants little motion gets few steps', async () => {
  const { page, context } = await open(rows);
  await page.emulateMedia({ reducedMotion: 'reduce' });
  const watch = await ready(page, 'watch');
  await watch.locator('.watch-scrub').press('Home');
  await watch.locator('.watch-play').click();
  await page.waitForTimeout(2000);
  const steps = await frame(watch);
  assert.ok(steps >= 1 && steps <= 8, `${steps} steps in 2 s`);
  await context.close();
});

test('maps are compared: the slider, the gain, the points of the maps change what is seen', async () => {
  const { page, problems, context } = await open(rows);
  const compare = await ready(page, 'compare-maps');
  const [scene, slider] = [compare.locator('.compare-scene'), compare.locator('.compare-slider')];
  assert.ok((await colors(scene)) > 50);
  const seen = [await pixels(scene)];
  const changed = async (what) => {
    const now = await pixels(scene);
    assert.ok(!seen.includes(now), what);
    seen.push(now);
  };
  await slider.focus();
  await page.keyboard.press('Home');
  await changed('Home');
  await page.keyboard.press('End');
  await changed('End');
  await page.keyboard.press('ArrowLeft');
  await changed('ArrowLeft');
  assert.match(await slider.getAttribute('aria-valuetext'), /^99 % gbs 1 %, the rest gbs\+f-km 1 %$/);
  await compare.locator('input[type="checkbox"]').check();
  await changed('points of the maps');
  await compare.locator('select').selectOption('gain');
  await changed('gain');
  assert.match(await compare.locator('.compare-legend').getAttribute('aria-label'), /nats gained/);
  assert.deepEqual(problems, []);
  await context.close();
});

test('both follow the colours of the page, fit every width, and print one still frame without controls', async () => {
  for (const width of [360, 800, 1920]) {
    const { page, problems, context } = await open(rows, { width });
    for (const kind of ['watch', 'compare-maps']) {
      const slot = await ready(page, kind);
      const canvas = slot.locator('canvas').first();
      const { width: wide } = await canvas.boundingBox();
      assert.ok(wide <= width && wide > 0.3 * Math.min(width, 700), `${kind}: ${wide} of ${width}`);
      const light = await pixels(canvas);
      await page.emulateMedia({ colorScheme: 'dark' });
      await page.waitForFunction(([element, was]) => element.toDataURL() !== was, [await canvas.elementHandle(), light]);
      await page.emulateMedia({ media: 'print' });
      assert.ok(await canvas.isVisible() && !(await slot.locator('input[type="range"]').isVisible()), kind);
      // Paper is light.
      await page.evaluate(() => dispatchEvent(new Event('beforeprint')));
      assert.equal(await canvas.evaluate((element) => [...element.getContext('2d').getImageData(0.4 * element.width, 3, 1, 1).data].slice(0, 3).every((channel) => channel > 200)), true, kind);
      await page.evaluate(() => dispatchEvent(new Event('afterprint')));
      await page.emulateMedia({ media: null, colorScheme: 'light' });
    }
    assert.deepEqual(problems, []);
    await context.close();
  }
});
