// SPDX-License-Identifier: Apache-2.0
// Writes the reference of the package for browsers, from the types and comments of its TypeScript, as HTML
// for the page sdk/docs/javascript.md. Exit code 1: TSC is not the program of TypeScript, an exported name
// has no comment, or a comment refers to a member that is not on the page; stderr names them.
// usage: node javascript.mjs TSC [FOLDER [FILE]]
// TSC: the program tsc. FOLDER: default sdk/web/src. FILE: default stdout; not written with exit code 1
import { existsSync, realpathSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const [tsc, folder = join(dirname(fileURLToPath(import.meta.url)), "../../web/src"), output] = process.argv.slice(2);
const library = join(dirname(realpathSync(tsc)), "../lib/typescript.js");
if (!existsSync(library)) {
  console.error(`javascript.mjs: ${tsc} is not in a package of TypeScript (${library} is missing); set STGS_TSC to bin/tsc of one`);
  process.exit(1);
}
const ts = createRequire(import.meta.url)(library);
const root = resolve(folder);
/** Sections: title, module, and the names to list if not those that it exports. */
const SECTIONS = [["<stgs-player>", "element/stgs_player", ["StgsPlayerElement"]], ["stgs", "index"],
  ["stgs/bridge", "stgs-bridge"], ["stgs/three", "three/index"], ["stgs/playcanvas", "playcanvas/index"],
  ["stgs/webgpu", "stgs-webgpu"], ["stgs/webgl2", "stgs-webgl2"]];
const sources = ts.sys.readDirectory(root, [".ts"]);
/** Declarations of other packages. */
const engines = new Set(sources.filter((name) => name.endsWith(".d.ts")));

/** Returns a program of the declarations of the sources. */
function declarations() {
  const options = { ...ts.convertCompilerOptionsFromJson(
    { target: "es2020", module: "es2020", moduleResolution: "node", lib: ["es2020", "dom", "dom.iterable"], types: [], strict: true,
      declaration: true, emitDeclarationOnly: true }, root).options };
  const texts = new Map([...engines].map((name) => [name, ts.sys.readFile(name)]));
  const checked = ts.createProgram(sources, options);
  checked.emit(undefined, (name, text) => texts.set(name, text), undefined, true);
  const host = ts.createCompilerHost(options);
  const { fileExists, readFile } = host;
  const isSource = (name) => name.startsWith(root + "/");
  host.fileExists = (name) => isSource(name) ? texts.has(name) : fileExists(name);
  host.readFile = (name) => isSource(name) ? texts.get(name) : readFile(name);
  host.getSourceFile = (name, version) => {
    if (!isSource(name)) return checked.getSourceFile(name);
    const text = texts.get(name);
    return text === undefined ? undefined : ts.createSourceFile(name, text, version, true);
  };
  return ts.createProgram([...texts.keys()], options, host);
}

const program = declarations(), checker = program.getTypeChecker();
const TYPES = ts.SymbolFlags.Class | ts.SymbolFlags.Interface | ts.SymbolFlags.TypeAlias | ts.SymbolFlags.Enum;
const isOwn = (node) => {
  const { fileName } = node.getSourceFile();
  return fileName.startsWith(root + "/") && !engines.has(fileName);
};
const isHidden = (node) => (ts.getCombinedModifierFlags(node) & (ts.ModifierFlags.Private | ts.ModifierFlags.Protected)) !== 0;
const resolved = (symbol) => symbol.flags & ts.SymbolFlags.Alias ? checker.getAliasedSymbol(symbol) : symbol;
const commentOf = (symbol) => ts.displayPartsToString(symbol.getDocumentationComment(checker)).trim();
const escape = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

/** Where symbols and "Class.member" are on the page. */
const ids = new Map(), members = new Map();
/** Types without an id that the page names, and references in comments to members that are not on it. */
const unlisted = new Set(), dangling = new Set();
/** The names of all types, also of those that are not on the page. */
const types = new Set(program.getSourceFiles().filter(isOwn).flatMap((file) => file.statements.map((node) => node.name?.text)));

function add(symbol) {
  if (ids.has(symbol)) return;
  const taken = [...ids.values()];
  let id = "js-" + symbol.name;
  for (let count = 2; taken.includes(id); ++count) id = `js-${symbol.name}-${count}`;
  ids.set(symbol, id);
}

/** The visible members: own, and inherited from what is neither on the page nor a type of the browser. */
function membersOf(symbol) {
  const isListed = (declaration) => isOwn(declaration) && !isHidden(declaration) &&
    (declaration.parent === undefined || !ids.has(declaration.parent.symbol) || declaration.parent.symbol === symbol);
  const instance = checker.getPropertiesOfType(checker.getDeclaredTypeOfSymbol(symbol));
  const statics = [...symbol.exports?.values() ?? []].filter(({ name }) => name !== "prototype");
  const all = symbol.flags & (ts.SymbolFlags.Class | ts.SymbolFlags.Interface) ? [...statics, ...instance] : [];
  return all.filter(({ name, declarations: list }) =>
    list?.every(isListed) && ts.isIdentifier(list[0].name) && !/^observedAttributes$|Callback$/.test(name));
}

/** A declaration as HTML, with links to the types on the page. `begin`, `end`: the part of its file. */
function code(node, begin = node.getStart(), end = node.getEnd()) {
  const text = node.getSourceFile().text;
  if (text[end - 1] === ";") --end;
  let html = "", at = begin;
  const visit = (child) => {
    if (ts.isIdentifier(child) && child.getStart() >= at && child.getEnd() <= end) {
      const found = checker.getSymbolAtLocation(child), symbol = found && resolved(found), id = ids.get(symbol);
      if (id === undefined && symbol !== undefined && symbol.flags & TYPES && symbol.declarations.every(isOwn)) unlisted.add(symbol);
      if (id !== undefined && child.parent.name !== child) {
        html += escape(text.slice(at, child.getStart())) + `<a href="#${id}">${escape(child.text)}</a>`;
        at = child.getEnd();
      }
    }
    ts.forEachChild(child, visit);
  };
  visit(node);
  return (html + escape(text.slice(at, end))).replace(/^(export )?(declare )?/, "").replace(/\s*\n\s*/g, " ");
}

/** The declarations of a member as HTML. A getter and its setter are one property. */
function signatures(symbol) {
  const list = symbol.declarations, getter = list.find(ts.isGetAccessor);
  if (getter === undefined) return list.map((declaration) => code(declaration));
  const isReadonly = !list.some(ts.isSetAccessor);
  return [`${isReadonly ? "readonly " : ""}${symbol.name}: ${code(getter.type)}`];
}

/** A comment as HTML: code, and links to what it names. */
function prose(text, where) {
  const parts = escape(text).replace(/`([^`]+)`/g, (_, name) => {
    const target = members.get(name) ?? [...ids].find(([symbol]) => symbol.name === name)?.[1];
    if (target !== undefined) return `<a href="#${target}"><code>${name}</code></a>`;
    if (/^\w+\.\w+$/.test(name) && types.has(name.split(".")[0]))
      dangling.add(`the comment of ${where} refers to ${name}, which is not in the reference`);
    return `<code>${name}</code>`;
  });
  return parts.split(/\n\s*\n/).map((paragraph) => `<p>${paragraph}</p>`).join("\n");
}

/** The bases of a class or interface as HTML: in place of those that are not on the page, their bases. */
function basesOf(node) {
  const bases = (node.heritageClauses ?? []).flatMap(({ token, types: list }) => token === ts.SyntaxKind.ExtendsKeyword ? list : []);
  return bases.flatMap((base) => {
    const type = checker.getTypeAtLocation(base).symbol;
    if (type === undefined || type.name === "__type" || ids.has(type)) return [code(base)];
    return type.declarations.every(isOwn) ? basesOf(type.declarations[0]) : [type.name];
  });
}

/** The head of a class or interface, or a whole declaration. */
function heading(symbol) {
  const node = symbol.declarations[0];
  if (!ts.isClassDeclaration(node) && !ts.isInterfaceDeclaration(node)) return symbol.declarations.map((each) => code(each)).join("\n");
  const bases = basesOf(node);
  const parameters = node.typeParameters?.map((each) => code(each)).join(", ");
  return (ts.isClassDeclaration(node) ? "class " : "interface ") + symbol.name + (parameters ? `&lt;${parameters}&gt;` : "") +
    (bases.length > 0 ? " extends " + bases.join(", ") : "");
}

function describe(symbol) {
  const id = ids.get(symbol), lines = [`<h3 id="${id}">${symbol.name}</h3>`, `<pre class="fragment">${heading(symbol)}</pre>`];
  const comment = commentOf(symbol);
  if (comment !== "") lines.push(prose(comment, symbol.name));
  const declaration = symbol.declarations[0];
  const isAbstract = (ts.getCombinedModifierFlags(declaration) & ts.ModifierFlags.Abstract) !== 0;
  const rows = declaration.members?.filter((node) => ts.isConstructorDeclaration(node) && !isHidden(node) && !isAbstract)
    .map((node) => ["constructor", [code(node)], ""]) ?? [];
  for (const member of membersOf(symbol)) rows.push([member.name, signatures(member), commentOf(member)]);
  if (rows.length > 0) lines.push("<dl>");
  for (const [name, list, text] of rows) {
    lines.push(`<dt id="${id}-${name}"><code>${list.join("</code><br/><code>")}</code></dt>`);
    lines.push(`<dd>${text === "" ? "" : prose(text, `${symbol.name}.${name}`)}</dd>`);
  }
  if (rows.length > 0) lines.push("</dl>");
  return lines;
}

const sections = SECTIONS.map(([title, module, names]) => {
  const file = program.getSourceFile(`${root}/${module}.d.ts`);
  if (file === undefined) return [title, []];
  const list = checker.getExportsOfModule(checker.getSymbolAtLocation(file)).map(resolved);
  return [title, names ? list.filter(({ name }) => names.includes(name)) : list];
});

/** Finds the members on the page, also by the classes that inherit them. */
function findMembers() {
  for (const [symbol, id] of ids)
    for (const { name, declarations: [declaration] } of membersOf(symbol))
      for (const owner of [symbol.name, declaration.parent.symbol.name])
        if (!members.has(`${owner}.${name}`)) members.set(`${owner}.${name}`, `${id}-${name}`);
  for (const symbol of ids.keys())
    for (const { name, declarations: list } of checker.getPropertiesOfType(checker.getDeclaredTypeOfSymbol(symbol))) {
      const inherited = members.get(`${list?.[0].parent.symbol?.name}.${name}`);
      if (inherited !== undefined && !members.has(`${symbol.name}.${name}`)) members.set(`${symbol.name}.${name}`, inherited);
    }
}

function page() {
  const lines = [], shown = new Set();
  for (const [title, symbols] of sections) {
    lines.push(`<h2 id="js-section-${title.replace(/\W+/g, "-")}">${escape(title)}</h2>`);
    const links = symbols.map((symbol) => `<a href="#${ids.get(symbol)}"><code>${symbol.name}</code></a>`);
    if (links.length > 1) lines.push(`<p>${links.join(", ")}</p>`);
    for (const symbol of symbols) if (!shown.has(symbol)) lines.push(...describe(symbol));
    for (const symbol of symbols) shown.add(symbol);
  }
  return lines.join("\n");
}

const exported = new Set(sections.flatMap(([, symbols]) => symbols));
exported.forEach(add);
page();
// And the types that the exported ones name, if they have a comment; those of WebGPU have none.
const others = [...unlisted].filter((symbol) => commentOf(symbol) !== "" && !symbol.name.startsWith("GPU"));
others.forEach(add);
sections.push(["Types that are not exported", others]);
findMembers();
const problems = [...exported].filter((symbol) => commentOf(symbol) === "").map(({ name }) => `${name} has no comment`);
dangling.clear();
const html = page() + "\n";
problems.push(...dangling);
for (const problem of problems) console.error(`javascript.mjs: ${problem}`);
process.exitCode = problems.length > 0 ? 1 : 0;
if (output === undefined) process.stdout.write(html);
else if (problems.length === 0) writeFileSync(output, html);
