export const title = "Calibration";
export async function show(place, app) { return null; }
