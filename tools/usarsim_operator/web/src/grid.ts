// How many rows and columns the camera tiles take: the chosen one as high as all rows at the left, the others in
// cells of 4:3 beside it. Pure.

export interface Layout {
  rows: number;
  columns: number;
  /** Cells of the last column, from below, that no tile takes. */
  spare: number;
}

const MOST_ROWS = 6;

/** The layout for n tiles that shows the largest pictures, with little left at the sides, in `width` x `height` (any unit). */
export function layout(n: number, width: number, height: number): Layout {
  let best: Layout = shape(n, 1);
  let most = 0;
  for (let rows = 1; rows <= (n > 2 ? MOST_ROWS : 1); rows++) {
    const one = shape(n, rows);
    const cell = Math.min(width / one.columns, (height / rows) * (4 / 3));
    const area = ((cell * cell * (rows * rows + n - 1)) / width) * cell * one.columns;
    // Two cells of room for a word about the team are fine, a column of nothing is not.
    if (area * (one.spare > 2 ? 0.6 : 1) > most) {
      most = area * (one.spare > 2 ? 0.6 : 1);
      best = one;
    }
  }
  return best;
}

function shape(n: number, rows: number): Layout {
  const side = Math.max(1, Math.ceil((n - 1) / rows));
  return { rows, columns: rows + side, spare: rows * side - (n - 1) };
}
