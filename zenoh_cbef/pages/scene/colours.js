// Colours of the stylesheet, and one for each agent.

export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

const AGENTS = ["#0072B2", "#E69F00", "#009E73", "#AA3377", "#56B4E9", "#A6761D", "#785EF0", "#117733"];

/** The colour of an agent, as its curves have it in figures. */
export const hue = (agent) => AGENTS[agent % AGENTS.length];
