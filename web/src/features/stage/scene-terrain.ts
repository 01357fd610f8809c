/** The ground that the 3D view draws, for the plans that the page draws over it. Pure. */

/** Below this height [m] a vertex is where the ground is unknown (`UNKNOWN_Z_M` in `gcs_server/scene/terrain.py`). */
const UNKNOWN_BELOW_M = -19_000;

export class SceneTerrain {
  private readonly side: number;

  /** @param vertices x (east), y (north), z (up) of the vertices in the world's ENU [m]: rows from south to north, each from west to east. */
  constructor(private readonly vertices: ArrayLike<number>) {
    this.side = Math.round(Math.sqrt(vertices.length / 3));
  }

  /** Height of the ground at a place [m]; null: unknown. */
  upAt(east_m: number, north_m: number): number | null {
    const column = this.lineBefore(east_m, (i) => this.vertices[3 * i] ?? 0);
    const row = this.lineBefore(north_m, (i) => this.vertices[3 * i * this.side + 1] ?? 0);
    if (column === null || row === null) return null;
    const up = (r: number, c: number): number => this.vertices[3 * (r * this.side + c) + 2] ?? UNKNOWN_BELOW_M;
    const [i, right] = column;
    const [j, down] = row;
    const corners = [up(j, i), up(j, i + 1), up(j + 1, i), up(j + 1, i + 1)] as const;
    if (corners.some((height) => height <= UNKNOWN_BELOW_M)) return null;
    return (corners[0] * (1 - right) + corners[1] * right) * (1 - down) + (corners[2] * (1 - right) + corners[3] * right) * down;
  }

  /** The line of the grid before a coordinate, and how far the coordinate is to the next line (0 to 1); null: outside. */
  private lineBefore(value: number, lineAt: (index: number) => number): readonly [number, number] | null {
    let [low, high] = [0, this.side - 1];
    if (!(value >= lineAt(low) && value <= lineAt(high))) return null;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (lineAt(middle) <= value) low = middle;
      else high = middle;
    }
    return [low, (value - lineAt(low)) / (lineAt(high) - lineAt(low))];
  }
}
