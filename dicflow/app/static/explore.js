export const title = "Explore";
export async function show(place, app) { return null; }
