export const title = "Run";
export async function show(place, app) { return null; }
