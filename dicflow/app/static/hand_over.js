export const title = "Hand over";
export async function show(place, app) { return null; }
