// Colours of the stylesheet, and one for each agent.

export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** A colour for each agent, apart from those of its neighbours in number. */
export const hue = (agent) => `hsl(${(agent * 137.508 + 205) % 360} 62% 48%)`;
