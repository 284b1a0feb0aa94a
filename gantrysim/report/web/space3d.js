// The 3-D views: of a run, and of several over one another.

export { ComparedView } from "./compared3d.js";
export { View } from "./view3d.js";
