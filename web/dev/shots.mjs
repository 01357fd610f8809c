// Takes screenshots of the page: node dev/shots.mjs URL FOLDER. Development only.
import { chromium } from 'playwright-core';

const [url = 'http://127.0.0.1:8090', folder = '/tmp/shots'] = process.argv.slice(2);
const browser = await chromium.launch({
  executablePath: '/usr/bin/chromium',
  args: ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-background-networking'],
});

async function shot(name, { width = 1440, height = 900, theme = 'dark', touch = false, act = async () => {} } = {}) {
  const context = await browser.newContext({ viewport: { width, height }, colorScheme: theme, hasTouch: touch });
  const page = await context.newPage();
  page.on('console', (m) => {
    if (['error', 'warning'].includes(m.type()) && !/502|WebGL|GPU/.test(m.text())) console.log(name, m.type(), m.text());
  });
  page.on('pageerror', (e) => console.log(name, 'pageerror', e.message));
  await page.goto(url);
  await page.waitForTimeout(2500);
  await act(page);
  await page.screenshot({ path: `${folder}/${name}.png` });
  await context.close();
}

const wanted = process.env.ONLY?.split(',');
const shots = {
  dark: {},
  'light-confirm': {
    theme: 'light',
    act: async (p) => {
      await p.keyboard.press('r');
      await p.waitForTimeout(400);
    },
  },
  small: {
    width: 1280,
    height: 720,
    act: async (p) => {
      await p.keyboard.press('t');
      await p.waitForTimeout(300);
    },
  },
  tablet: {
    width: 1024,
    height: 768,
    theme: 'light',
    touch: true,
    act: async (p) => {
      await p.keyboard.press('Shift+K');
      await p.waitForTimeout(300);
    },
  },
  help: {
    act: async (p) => {
      await p.keyboard.press('?');
      await p.getByRole('button', { name: /^Battery/ }).click();
      await p.waitForTimeout(300);
    },
  },
};
for (const [name, options] of Object.entries(shots)) if (!wanted || wanted.includes(name)) await shot(name, options);
await browser.close();
