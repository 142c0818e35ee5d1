export const title = "Settings";
export async function show(place, app) { return null; }
