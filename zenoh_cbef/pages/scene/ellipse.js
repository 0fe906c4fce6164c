// Where a target is with 95 %, by a position's covariance.

const REACH = Math.sqrt(5.991); // 95 % of a normal distribution in a plane

/** The covariance (upper triangle, m^2) seen along a view: half axes in pixels, and angle. */
export function outline(view, [xx, xy, xz, yy, yz, zz]) {
  if (!Number.isFinite(xx)) return null;
  const P = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
  const dot = (m, n) => m.reduce((sum, a, i) => sum + a * P[i].reduce((inner, p, j) => inner + p * n[j], 0), 0);
  const [m, n] = view.now;
  const [a, b, d] = [dot(m, m), dot(m, n), dot(n, n)];
  const middle = (a + d) / 2;
  const root = Math.hypot((a - d) / 2, b);
  const size = (value) => REACH * Math.sqrt(Math.max(value, 0)) * view.scale;
  return { major: size(middle + root), minor: size(middle - root), angle: Math.atan2(2 * b, a - d) / 2 };
}
