// Shows the theme before the first paint; `src/app/settings.svelte.ts` stores it. The language is a cookie, which the server reads.
(() => {
  const root = document.documentElement;
  let values = {};
  try {
    values = JSON.parse(localStorage.getItem('gcs-settings-1')).values ?? {};
  } catch {
    // nothing is stored, or storage is disabled
  }
  const isDark = values.theme === 'dark' || (values.theme !== 'light' && matchMedia('(prefers-color-scheme: dark)').matches);
  root.dataset.theme = isDark ? 'dark' : 'light';
})();
