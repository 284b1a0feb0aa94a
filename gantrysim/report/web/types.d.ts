// Types of the page's and the workbench's modules, for `tsc --noEmit`; no part of what browsers get.

/** A column as it is sent, see gantrysim/report/encoding.py; bytes are base64 on the page, and bytes in the workbench. */
type ColumnContent = CodedColumn | AscendingColumn | RunsColumn;

interface CodedColumn {
  kind: "u16" | "d8";
  data: string | Uint8Array;
  jumps?: string | Uint8Array;
  offset: number;
  scale: number;
}

interface AscendingColumn {
  kind: "ascending";
  data: string | Uint8Array;
  first: number;
}

interface RunsColumn {
  kind: "runs";
  values: number[];
  counts: number[];
}

interface SeriesContent {
  name: string;
  label: string;
  unit: string;
  group: string;
  decimals: number;
  colour?: string | null;
  dash?: number[];
  meaning?: string;
  /** Of a comparison: the quantity without the number of its run. */
  quantity?: string;
  run?: number;
}

interface DotContent {
  x: number;
  y: number;
  z: number;
  radius: number;
  height: number;
  error: number | null;
  failed: boolean;
  row: number;
}

/** Kind, three sizes, position, rotation w, x, y, z, and whether it is the needle. */
type Solid = [string, number, number, number, number, number, number, number, number, number, number, boolean];

interface PartContent {
  name: string;
  pose: (number | ColumnContent)[];
}

interface SpaceContent {
  gap: number;
  poses: number;
  parts: PartContent[];
}

/** A run, see gantrysim/report/viewer_data.py. */
interface RunContent {
  rows: number;
  ticks: number;
  period: number;
  start: number;
  columns: Record<string, ColumnContent>;
  series: SeriesContent[];
  corners: [number, number, number][];
  program: Record<string, string> | null;
  magnification: number;
  worst: number | null;
  worst_value: string;
  passes: boolean;
  shown: string;
  path_statistic: string;
  path_tolerance: number;
  width: number | null;
  width_tolerance: number;
  unjudged_ends: [number, number] | null;
  dots: DotContent[];
  space: SpaceContent | null;
  solids: Solid[][] | null;
}

interface RunLooks {
  name: string;
  colour: string | null;
  dash: number[];
}

/** Several runs, see gantrysim/compare/runs/overlay_data.py. */
interface ComparedContent {
  rows: number;
  worst: number | null;
  by_path: boolean;
  columns: Record<string, ColumnContent>;
  runs: RunLooks[];
  quantities: SeriesContent[];
  magnification: number;
  path_tolerance: number | null;
  width: number | null;
  width_tolerance: number | null;
  /** From nozzle to surface, of each run, where there is a 3-D view [mm]. */
  gaps: number[] | null;
}

type Values = Float64Array;
type Columns = Record<string, Values>;
type Line = { x: ArrayLike<number>; y: ArrayLike<number> };
type Point = { x: number; y: number };
type Frame = { x: number; y: number; z: number };
type Box3 = Record<"x" | "y" | "z", [number, number]>;
type Rgb = number[];
/** Value, place and colour of a stop of a colour scale. */
type Stop = [number, number, Rgb];
type Stretch = [number, number];
type Attributes = Record<string, unknown>;
/** Where a text may stand on a canvas: x, y of its middle, and its alignment. */
type TextPlace = [number, number, CanvasTextAlign];
type TextLooks = { fillStyle?: string; halo?: string; always?: boolean };
type Context = CanvasRenderingContext2D;

interface Theme {
  ink: string;
  soft: string;
  line: string;
  paper: string;
  alarm: string;
  near: string;
  shares: Stop[];
  widths: Stop[];
}

interface Gestures {
  hover(x: number, y: number): void;
  click(x: number, y: number): void;
  zoom(factor: number, x: number, y: number): void;
  pan(dx: number, dy: number): void;
  /** Without a box the drag has ended. */
  dragging(...box: [] | [number, number, number, number]): void;
  box(x0: number, y0: number, x1: number, y1: number): void;
  reset(): void;
}

interface Turns {
  hover(x: number, y: number): void;
  click(x: number, y: number): void;
  turn(azimuth: number, elevation: number): void;
  pan(dx: number, dy: number): void;
  zoom(factor: number, x?: number, y?: number): void;
  reset(): void;
}

interface MapOptions {
  name: string;
  data: RunData | ComparedData;
  cursor: Cursor;
  region: Region;
  points(row: number): Point;
  draw(context: Context, map: PlanMap, colours: Theme): void;
  describe(row: number): string;
  marks?(row: number): (Point & { colour?: string | null })[];
}

interface StripGroup {
  names: string[];
  own: boolean;
  heading?: string;
}

interface Strip extends StripGroup {
  box: HTMLElement;
  single: boolean;
  errors: boolean;
  value: HTMLElement;
  last: boolean;
  /** Whether it is near the window, and whether it shows data before the present ones, as it was not. */
  inSight: boolean;
  outdated: boolean;
  plot: uPlot;
}

/** A view of a run that shows further data in place. */
interface RunView {
  element: HTMLElement;
  map?: PlanMap;
  update(): void;
  remove?(): void;
}

type uPlot = import("uplot");
type RunData = import("./data.js").RunData;
type ComparedData = import("./compared.js").ComparedData;
type Cursor = import("./cursor.js").Cursor;
type Region = import("./map.js").Region;
type PlanMap = import("./map.js").PlanMap;
type Camera = import("./camera3d.js").Camera;
type Labels = import("./labels3d.js").Labels;
type Scale3d = import("./scale3d.js").Scale3d;
type Controls = import("../../live/web/controls.js").Controls;
type Ground = import("./ground3d.js").Ground;
type Scene3d<Data extends RunData | ComparedData> = import("./scene3d.js").Scene3d<Data>;

/** What a ribbon is made of: a run, or one of several over one another. */
interface BeadInSpace {
  rows: number;
  column: Columns;
  width: number | null;
  space: { gap: number } | null;
}

/** A 3-D view: of a run, or of several over one another. */
interface SpaceView {
  children: HTMLElement[];
  update(): void;
  remove(): void;
}

interface Window {
  gantrysimSpace: typeof import("./space3d.js");
}

// messages of the workbench, see gantrysim/live

interface ControlContent {
  key: string;
  group: string;
  label: string;
  unit: string;
  meaning: string;
  value: number | string | string[];
  initial: number | string | string[];
  low: number;
  high: number;
  is_ratio: boolean;
  options: string[];
  additions: string[];
}

interface RowContent {
  name: string;
  state: string;
  symbol: string;
  texts: string[];
}

interface VerdictContent {
  state: string;
  headline: string;
  rows: RowContent[];
}

interface BesideContent {
  name: string;
  sentence: string;
  notes: string[];
  failed: boolean;
}

interface Head extends VerdictContent {
  number: number;
  engine: string;
  name: string;
  time: number;
  sentence?: string;
  kept?: VerdictContent;
  beside?: BesideContent;
}

interface Refusal {
  text: string;
  line: number;
  word: string;
  task: string;
}

interface Proposals {
  sentence: string;
  heads: string[];
  proposals: { label: string; usages: string[]; cost: string }[];
}

interface BesideState {
  name: string;
  path: string;
  version: number;
  columns: string;
  period: number | null;
}

interface BesideState {
  name: string;
  path: string;
  version: number;
  columns: string;
  period: number | null;
}

interface State {
  jobs: Record<string, string[]>;
  folder: string;
  path: string;
  changed: boolean;
  can_undo: boolean;
  can_redo: boolean;
  kept: boolean;
  beside: BesideState | null;
  filmed: boolean;
  saved: string;
  busy: string;
  number: number;
}

interface Texts {
  program: string | null;
  job: string | null;
}

/** What the page does with messages, by their kinds. */
interface Listeners {
  found(): void;
  lost(): void;
  state(state: State): void;
  text(texts: Texts): void;
  controls(message: { controls: ControlContent[] }): void;
  margins(message: { row: RowContent }): void;
  progress(progress: { share: number; task: string }): void;
  compiling(message: { text: string }): void;
  proposals(proposals: Proposals): void;
  written(message: { folder: string; page: string }): void;
  film(film: { name: string; number: number }): void;
  refused(refusal: Refusal): void;
  remark(message: { text: string }): void;
  result(head: Head, content: RunContent | ComparedContent, bytes: number): void;
}

/** Elements of the workbench's page that are more than an HTMLElement, by their ids. */
interface PageElements {
  assign: HTMLDetailsElement;
  columns: HTMLInputElement;
  file: HTMLInputElement;
  jobs: HTMLSelectElement;
  period: HTMLInputElement;
  progress: HTMLProgressElement;
  saving: HTMLDialogElement;
  video: HTMLVideoElement;
}

type Job = { kind: string; name: string };
/** A row of the controls: its element, and what shows a value in it. */
type ControlRow = { element: HTMLElement; set(value: ControlContent["value"]): void };
