// Build mjsheaf/page/bundle.js and bundle.css, with the licences of what is in them; `make bundle` calls this.
// Another directory may be named.

import { build } from "esbuild";
import { readFileSync } from "node:fs";

const home = process.argv[2] ?? new URL("../mjsheaf/page/", import.meta.url).pathname;
const licences = ["three", "uplot"].map((name) => {
  const { version } = JSON.parse(readFileSync(`node_modules/${name}/package.json`));
  return `${name} ${version}\n\n${readFileSync(`node_modules/${name}/LICENSE`, "utf8").trim()}\n`;
});
await build({
  entryPoints: { bundle: "src/main.js" },
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "ascii",
  legalComments: "none",
  banner: { js: `/*\n${licences.join("\n\n")}*/` },
  outdir: home,
  logLevel: "warning",
});
