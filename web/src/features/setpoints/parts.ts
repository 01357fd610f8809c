/** What the offboard room is made of, in one piece that is loaded when it is opened. */

export { default as HealthCard } from './HealthCard.svelte';
export { default as OffboardRoom } from './OffboardRoom.svelte';
export { default as SentCard } from './SentCard.svelte';
