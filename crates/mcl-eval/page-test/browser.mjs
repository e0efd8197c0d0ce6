// What the tests of the page share: reports, and pages in a browser that has no network.
import { execFileSync } from 'node:child_process';
import { existsSync, mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';
import { chromium } from 'playwright-core';

export const ROOT = resolve(fileURLToPath(import.meta.url), '../../../..');
const PROGRAM = resolve(ROOT, process.env.MCL_EVAL ?? 'target/release/mcl-eval');
const CHROMIUM = [process.env.CHROMIUM, '/usr/bin/chromium', '/usr/bin/chromium-browser'].find((path) => path && existsSync(path));

/// A folder of this process, removed at its end.
export const scratch = mkdtempSync(join(tmpdir(), 'mcl-eval-page-'));
process.on('exit', () => rmSync(scratch, { recursive: true, force: true }));

/// Runs the program; exit code 3 says that something is missing, which pages show, too.
export const program = (...args) => {
  try {
    return execFileSync(PROGRAM, args, { cwd: ROOT, encoding: 'utf8', stdio: ['ignore', 'pipe', 'pipe'] });
  } catch (error) {
    if (error.status !== 3) throw new Error(`mcl-eval ${args.join(' ')}: ${error.stderr}`);
    return error.stdout;
  }
};

/// The page of some roots; returns its path.
export const report = (name, ...roots) => {
  const path = join(scratch, `${name}.html`);
  program('report', ...roots, '-o', path, '-q');
  return path;
};

/// A study with rows: the paper's four kinds of map on the simulated office, two sizes.
export const withRows = () => {
  const root = join(scratch, 'rows');
  for (const [name, more] of [
    ['likelihood', 'measures = ["likelihood"]\n[[trials]]\nmap = ["gbs", "gbs+f-km", "rnd", "rnd+f-km"]\nsize = [0.25, 1]\ndraws = 4\n' +
      '[[views.tests]]\ny = "log_likelihood"\npairs = [["gbs+f-km", "gbs"], ["rnd+f-km", "rnd"]]\n' +
      '[[views.charts]]\nname = "likelihood"\nx = { column = "real_percent", scale = "log" }\ny = { column = "log_likelihood", scale = "symlog" }\n'],
    ['localization', '[[trials]]\nmap = ["gbs", "gbs+f-km", "rnd", "rnd+f-km"]\nsize = [0.25, 1]\ndraws = 2\nruns = 1\nparticles = 100\n' +
      '[[views.tests]]\ny = "weighted"\nratio = true\n' +
      '[[views.charts]]\nname = "errors"\nx = { column = "size_percent", scale = "log" }\ny = { column = ["weighted", "translation"], scale = "log" }\nmarks = "diverged"\ncolumns = 2\n'],
  ]) {
    const study = join(scratch, `${name}.toml`);
    writeFileSync(study, `# Made for a test of the page.\nseed = 1\n${more}[[dataset]]\nname = "simulated-office"\nscans = 200\n`);
    program('run', study, '--dataset', 'simulated-office', '-o', root, '-q');
  }
  return root;
};

/// A result folder whose every text is hostile.
export const hostile = () => {
  const bad = `<script>window.hacked = 1</script><img src=x onerror="window.hacked = 2">&amp;"'\`\u202e\u001b[31m`;
  const root = join(scratch, 'hostile');
  const folder = join(root, '<img src=x onerror=hacked=3>', `<b>bold\u202e${'x'.repeat(180)}`);
  const write = (name, text) => {
    mkdirSync(dirname(join(folder, name)), { recursive: true });
    writeFileSync(join(folder, name), text);
  };
  const cell = (text) => `"${text.replaceAll('"', '""')}"`;
  write('manifest.json', JSON.stringify({
    study: bad,
    identity: {
      build: { version: bad, revision: null, sources: bad },
      data: { name: bad, title: bad + 'y'.repeat(10000), sha256: bad, dimensions: 2, scans: 1, max_range: null, points: 1, skipped_records: 0 },
    },
  }));
  write('study.toml', `# ${bad}\n</code></pre>${bad}`);
  write('summary.csv', `dataset,map,${cell(bad)}\n${cell(bad)},${cell(bad)},1\n=1+1,${cell('z'.repeat(10000))},2\n`);
  write('tests.csv', `dataset,split,size_percent,y,column,a,b,test,kind,effect,effect_low,effect_high,blocks,t,df,p,p_holm,note\n${cell(bad)},${cell(bad)},1,${cell(bad)},map,${cell(bad)},b,paired,difference,1,0.5,1.5,3,9,2,0.001,0.001,${cell(bad)}\n`);
  write('failures.csv', `trial,reason\n${cell(bad)},${cell(bad)}\n`);
  write(`figures/<img src=x>.csv`, `panel,measure,curve,x,y,low,high,blocks,rows,mark\n${cell(bad)},${cell(bad)},${cell(`<a href="https://example.org">${bad}`)},1,2,1,3,4,5,${cell(bad)}\n`);
  write(`figures/<img src=x>.svg`, `<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"><script>window.hacked = 4</script></svg>`);
  return root;
};

let browser = null;
const launched = () => (browser ??= chromium.launch({ executablePath: CHROMIUM, args: process.getuid?.() === 0 ? ['--no-sandbox'] : [] }));
export const close = async () => {
  await (await browser)?.close();
  browser = null;
};

/// A page from its file, in a browser without network. `problems` gathers what must not be: errors of the console and of
/// scripts, and requests.
export const open = async (path, { width = 1280, height = 900, theme = 'light', hash = '' } = {}) => {
  const context = await (await launched()).newContext({ viewport: { width, height }, colorScheme: theme, offline: true, acceptDownloads: true });
  await context.grantPermissions(['clipboard-read', 'clipboard-write']);
  const page = await context.newPage();
  const problems = [];
  page.on('console', (message) => ['error', 'warning'].includes(message.type()) && problems.push(`console: ${message.text()}`));
  page.on('pageerror', (error) => problems.push(`error: ${error.message}`));
  page.on('request', (request) => /^(file|blob|data):/.test(request.url()) || problems.push(`request: ${request.url()}`));
  page.on('dialog', (dialog) => problems.push(`dialog: ${dialog.message()}`));
  await page.addInitScript(() => {
    window.shifts = 0;
    new PerformanceObserver((list) => { for (const shift of list.getEntries()) if (!shift.hadRecentInput) window.shifts += shift.value; }).observe({ type: 'layout-shift', buffered: true });
  });
  await page.goto(pathToFileURL(path).href + hash);
  await page.waitForFunction(() => performance.getEntriesByName('ready').length > 0);
  return { page, problems, context };
};

/// Brings an element into view and waits until its chart is drawn.
export const drawn = async (chart) => {
  await chart.scrollIntoViewIfNeeded();
  await chart.locator('xpath=self::*[@data-drawn="yes"]').waitFor({ state: 'attached', timeout: 60000 });
};
