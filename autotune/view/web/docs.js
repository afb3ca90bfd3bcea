// The API's description, from its own openapi.json.

import { ask, takeToken } from "/web/api.js";

const element = (name, text, attributes = {}) => Object.assign(document.createElement(name), { textContent: text, ...attributes });

function operation(method, path, one) {
  const box = element("details", ""), head = element("summary", "");
  head.append(element("strong", `${method.toUpperCase()} ${path}`), ` ${(one.description || one.summary || "").split("\n")[0]}${one.security ? " (needs the token)" : ""}`);
  box.append(head, element("p", one.description || "", { className: "quiet" }));
  for (const parameter of one.parameters || []) {
    const schema = parameter.schema || {};
    box.append(element("p", `${parameter.name} (${parameter.in}${parameter.required ? ", required" : ""}): ${schema.type || "one of several"}${schema.default === undefined ? "" : `, by default ${schema.default}`}`));
  }
  const body = one.requestBody?.content?.["application/json"]?.schema;
  if (body) box.append(element("pre", JSON.stringify(body, null, 2)));
  for (const [code, answer] of Object.entries(one.responses || {})) box.append(element("p", `${code}: ${answer.description}`, { className: "quiet" }));
  return box;
}

async function begin() {
  const description = await ask("/openapi.json");
  const byTag = {};
  for (const [path, methods] of Object.entries(description.paths))
    for (const [method, one] of Object.entries(methods)) (byTag[one.tags?.[0] || "other"] ||= []).push(operation(method, path, one));
  document.getElementById("list").replaceChildren(
    ...Object.entries(byTag).map(([tag, list]) => {
      const section = element("section", "");
      section.append(element("h2", tag), ...list);
      return section;
    }),
  );
  document.getElementById("status").textContent = `${description.info.title} ${description.info.version}`;
}

takeToken();
begin().catch((error) => { document.getElementById("status").textContent = error.message; });
