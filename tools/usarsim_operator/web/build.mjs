// Bundles the page into ../page (git-ignored) or the folder named, or, with --tests, each test into build/tests.
// The output depends on the sources and the lock file alone: two builds are byte-identical.
import { cpSync, mkdirSync, readdirSync, rmSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
process.chdir(here);

if (process.argv.includes("--tests")) {
  const files = readdirSync("test").filter((name) => name.endsWith(".test.ts"));
  rmSync("build/tests", { recursive: true, force: true });
  await build({
    entryPoints: files.map((name) => join("test", name)),
    outdir: "build/tests",
    outExtension: { ".js": ".mjs" },
    bundle: true,
    platform: "node",
    format: "esm",
    logLevel: "warning",
  });
} else {
  const target = resolve(process.argv[2] ?? join("..", "page"));
  rmSync(target, { recursive: true, force: true });
  mkdirSync(target, { recursive: true });
  await build({
    entryPoints: [
      { in: "src/main.ts", out: "page" },
      { in: "style.css", out: "style" },
      { in: "src/study/main.ts", out: "study" },
      { in: "study.css", out: "study" },
      { in: "src/explore/main.ts", out: "explore" },
      { in: "explore.css", out: "explore" },
    ],
    outdir: target,
    bundle: true,
    minify: true,
    format: "esm",
    target: "es2022",
    legalComments: "linked",
    logLevel: "warning",
  });
  // What `usarsim share` puts into one file: a program without modules, its licenses within.
  await build({
    entryPoints: [
      { in: "src/share/main.ts", out: "share" },
      { in: "share.css", out: "share" },
    ],
    outdir: target,
    bundle: true,
    minify: true,
    format: "iife",
    target: "es2022",
    legalComments: "eof",
    logLevel: "warning",
  });
  for (const name of ["index.html", "study.html", "explore.html", "share.html", "icon.svg"])
    cpSync(name, join(target, name));
}
