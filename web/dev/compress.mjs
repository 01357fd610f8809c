/** Writes compressed forms of the built page's files beside them; the server sends them as they are (`gcs_server/encodings.py`). */

import { readdir, readFile, writeFile } from 'node:fs/promises';
import { join } from 'node:path';
import { brotliCompressSync, gzipSync } from 'node:zlib';

const FOLDER = new URL('../../gcs_server/static/', import.meta.url).pathname;
/** Kinds of files that are worth compressing, and the size from which it saves a packet [bytes]. */
const COMPRESSED = /\.(m?js|css|html|svg|json|txt|webmanifest)$/;
const MIN_BYTES = 1400;

for (const name of await readdir(FOLDER, { recursive: true })) {
  if (!COMPRESSED.test(name)) continue;
  const content = await readFile(join(FOLDER, name));
  if (content.length < MIN_BYTES) continue;
  await writeFile(join(FOLDER, `${name}.br`), brotliCompressSync(content));
  await writeFile(join(FOLDER, `${name}.gz`), gzipSync(content, { level: 9 }));
}
